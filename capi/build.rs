//! The name that programs look the shared library up by: before version 1 each minor version has an API of its own, and
//! a program does not start with another one.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let var = |name: &str| std::env::var(name).unwrap_or_default();
    let version = format!(".{}.{}", var("CARGO_PKG_VERSION_MAJOR"), var("CARGO_PKG_VERSION_MINOR"));
    let suffix = match &*var("CARGO_CFG_TARGET_OS") {
        "linux" | "freebsd" | "netbsd" | "openbsd" => &*version,
        // Takes libraries by names that end in .so alone, and those without a name by the path that a host was linked
        // with.
        "android" => "",
        _ => return, // say it in ways of their own
    };
    println!("cargo::rustc-cdylib-link-arg=-Wl,-soname,libdeltamorph_c.so{suffix}");
}
