//! `coordinator verify`: are these the numbers that this data and this program give?

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use artefact::Recogniser;
use cache::StorageArgs;
use clap::Args;

use super::sign::RUN_FILES;
use crate::signing::PublicKey;
use crate::{sweep, verify};

/// Recompute the digest of a finished run and a sample of its fitness values
///
/// With a sample, the front of a search of several objectives is found again among all evaluations, and errors by set are
/// counted again from the answers.
///
/// Example: coordinator verify results/runs/demo-0123456789ab --sample 20
#[derive(Debug, Args)]
pub struct Verify {
    /// The folder of a run or a sweep, for example results/runs/demo-0123456789ab
    #[arg(value_name = "RUN")]
    run: PathBuf,
    /// How many fitness values to compute again, for example 20; 0 looks at the digest only
    #[arg(long, value_name = "N", default_value_t = 10)]
    sample: u32,
    /// Another place of the data set, for example /data/rgbd; by default the one the run used
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Whoever must have signed it: a public key, or its file, for example results.key.pub. With it, the folder of an
    /// artefact can be given, too
    #[arg(long, value_name = "PUBLIC")]
    key: Option<String>,
    #[command(flatten)]
    storage: StorageArgs,
}

impl Verify {
    pub(super) fn execute(self) -> anyhow::Result<ExitCode> {
        let key = self.key.as_deref().map(PublicKey::read).transpose()?;
        if let Some(key) = key.filter(|_| self.run.join(artefact::SETTINGS).is_file()) {
            return verify_artefact(&self.run, key);
        }
        let storage = self.storage.resolve();
        let mut sound = true;
        for (member, folder) in sweep::run_folders(&self.run)? {
            let verify = verify::verify(&folder, self.sample, self.data.clone(), &storage);
            let mut verdict =
                super::block_on("run the same command to begin again", async { Ok(verify.await?) })?;
            if let Some(key) = key {
                verdict.add_signature(key, key.verify(&folder, &RUN_FILES));
            }
            sound &= verdict.is_sound();
            let title = if member.is_empty() { member } else { format!("{member}\n") };
            super::print(&format!("{title}{verdict}"))?;
        }
        Ok(if sound { ExitCode::SUCCESS } else { ExitCode::FAILURE })
    }
}

/// Whether the owner of this key has signed an artefact, and its files fit together.
fn verify_artefact(folder: &Path, key: PublicKey) -> anyhow::Result<ExitCode> {
    Recogniser::open(folder)?;
    let (verdict, code) = match key.verify(folder, &artefact::FILES) {
        Ok(()) => (format!("sound: artefact, signed by {key}\n"), ExitCode::SUCCESS),
        Err(problem) => (format!("{problem}\nNOT sound\n"), ExitCode::FAILURE),
    };
    super::print(&verdict)?;
    Ok(code)
}
