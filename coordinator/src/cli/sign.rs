//! `--sign-key`: what a command has written is signed.

use std::path::{Path, PathBuf};

use clap::Args;

use crate::signing::SigningKey;

/// The file of a run that all others follow from: its digests are of them.
pub(super) const RUN_FILES: [&str; 1] = ["run/run.parquet"];

/// Who signs.
#[derive(Debug, Args)]
pub struct Sign {
    /// Sign the result with this key, as coordinator keygen makes it, for example results.key
    #[arg(long, value_name = "KEY")]
    sign_key: Option<PathBuf>,
}

impl Sign {
    /// The key, read before anything is spent.
    pub(super) fn key(&self) -> anyhow::Result<Option<SigningKey>> {
        Ok(self.sign_key.as_deref().map(SigningKey::read).transpose()?)
    }
}

/// Signs these files of a folder, if there is a key.
pub(super) fn sign(key: Option<&SigningKey>, folder: &Path, files: &[&str]) -> anyhow::Result<()> {
    Ok(key.map_or(Ok(()), |key| key.sign(folder, files))?)
}
