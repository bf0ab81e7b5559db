//! The loader unloads layers with the last instance; this layer stays loaded, so that its counts continue.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rustc-cdylib-link-arg=-Wl,-z,nodelete");
}
