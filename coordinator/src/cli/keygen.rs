//! `coordinator keygen`: a key with which results are signed.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;

use crate::console::say;
use crate::signing::{SigningKey, public_file};

/// Make a key (ed25519) to sign runs and artefacts with; print its public key
///
/// The key goes to a file that only its owner can read, the public key beside it. Give the public key to whoever shall
/// verify: `coordinator verify RUN --key PUBLIC`.
///
/// Example: coordinator keygen results.key
#[derive(Debug, Args)]
pub struct Keygen {
    /// File of the key, for example results.key; never overwritten
    #[arg(value_name = "KEY")]
    key: PathBuf,
}

impl Keygen {
    pub(super) fn execute(self) -> anyhow::Result<ExitCode> {
        let public = SigningKey::make(&self.key)?;
        let (key, public_file) = (self.key.display(), public_file(&self.key));
        say(format_args!("made {key}: sign with --sign-key {key}"));
        let public_file = public_file.display();
        say(format_args!(
            "made {public_file}: whoever verifies needs it: coordinator verify RUN --key {public_file}"
        ));
        super::print(&format!("{public}\n"))?;
        Ok(ExitCode::SUCCESS)
    }
}
