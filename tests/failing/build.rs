//! The loader unloads layers with the last instance; this layer stays loaded, so that its counts continue.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    // Linkers of Windows and macOS have no such option.
    if std::env::var("CARGO_CFG_TARGET_OS").is_ok_and(|system| system == "linux") {
        println!("cargo::rustc-cdylib-link-arg=-Wl,-z,nodelete");
    }
}
