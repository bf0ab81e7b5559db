//! Nothing: the test is `tests/threads.rs`.
