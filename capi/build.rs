//! The name that programs look the shared library up by: before version 1 each minor version has an API of its own, and
//! a program does not start with another one.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let var = |name: &str| std::env::var(name).unwrap_or_default();
    // Android takes libraries by names that end in .so alone; others say it in other ways.
    if ["linux", "freebsd", "netbsd", "openbsd"].contains(&&*var("CARGO_CFG_TARGET_OS")) {
        let (major, minor) = (var("CARGO_PKG_VERSION_MAJOR"), var("CARGO_PKG_VERSION_MINOR"));
        println!("cargo::rustc-cdylib-link-arg=-Wl,-soname,libdeltamorph_c.so.{major}.{minor}");
    }
}
