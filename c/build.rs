//! What linkers and loaders must know of the shared library: the name that programs remember, and that it stays loaded.

/// Rises when a program that was linked with an earlier library can no longer use a later one.
const ABI: u32 = 0;

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    if std::env::var("CARGO_CFG_TARGET_OS").as_deref() == Ok("linux") {
        println!("cargo:rustc-cdylib-link-arg=-Wl,-soname,libdescry_recognise.so.{ABI}");
        // Threads that learn, and what threads remember of errors, outlive `dlclose`.
        println!("cargo:rustc-cdylib-link-arg=-Wl,-z,nodelete");
    }
}
