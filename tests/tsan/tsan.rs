//! Empty: the test is `tests/threads.rs`.
