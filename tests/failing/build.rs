//! The loader unloads layers with the last instance: the layer stays, so that it counts on with the next.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rustc-cdylib-link-arg=-Wl,-z,nodelete");
}
