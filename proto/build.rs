//! Compiles the .proto files with protox, so that no `protoc` has to be installed.

use std::error::Error;
use std::path::PathBuf;
use std::{env, fs};

use prost::Message;

const FILES: [&str; 4] = [
    "descry/v1/coordinator.proto",
    "descry/v2/coordinator.proto",
    "descry/v2/task.proto",
    "descry/v2/journal.proto",
];
/// Clients and servers need tonic; messages do not.
const SERVICES: &str = "#[cfg(feature = \"services\")]";

fn main() -> Result<(), Box<dyn Error>> {
    for file in FILES {
        println!("cargo:rerun-if-changed={file}");
    }
    let descriptors = protox::compile(FILES, ["."])?;
    let out = PathBuf::from(env::var("OUT_DIR")?);
    fs::write(out.join("descriptor_set.bin"), descriptors.encode_to_vec())?;
    tonic_prost_build::configure()
        .codec_path("crate::BoundedCodec")
        .client_mod_attribute(".", SERVICES)
        .server_mod_attribute(".", SERVICES)
        .compile_fds(descriptors)?;
    Ok(())
}
