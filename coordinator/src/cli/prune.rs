//! `coordinator prune`: removes from a shared bucket what is old.

use std::process::ExitCode;
use std::time::{Duration, SystemTime};

use anyhow::Context as _;
use cache::{BucketUrl, ByteSize, Pruned};
use clap::Args;

use crate::shared_bucket::Bucket;

const DAY: Duration = Duration::from_secs(24 * 60 * 60);

/// Remove from a shared bucket what was stored long ago
///
/// Only clouds and what Descry has computed from them, below the prefix; runs that need it make it again. Whatever else is
/// there stays. The key to the bucket is read from the environment, as for --shared.
///
/// Example: coordinator prune s3://lab-cache/descry --days 30 --dry-run
#[derive(Debug, Args)]
pub struct Prune {
    /// The bucket, for example s3://lab-cache/descry
    #[arg(value_name = "URL")]
    bucket: BucketUrl,
    /// Remove what was stored more than so many days ago, for example 30; 0 removes everything
    #[arg(long, value_name = "N")]
    days: u32,
    /// Only count what would be removed, for example to see how much it is
    #[arg(long)]
    dry_run: bool,
}

impl Prune {
    pub(super) fn execute(self) -> anyhow::Result<ExitCode> {
        let Self { bucket: url, days, dry_run } = self;
        let before = SystemTime::now().checked_sub(DAY * days);
        let before = before.with_context(|| format!("--days: too many, got {days}\nchoose fewer"))?;
        let bucket = Bucket::open(&url)?;
        let prune = async { Ok(bucket.prune(before, dry_run).await?) };
        let Pruned { old, kept, foreign } = super::block_on("run it again to remove the rest", prune)?;
        let objects = |(objects, bytes): (u64, u64)| format!("{objects} objects, {}", ByteSize(bytes));
        let done = if dry_run { "would remove" } else { "removed" };
        let mut text = format!("{url}: {done} {}; {} stay\n", objects(old), objects(kept));
        if foreign > 0 {
            text.push_str(&format!("{foreign} objects there are not Descry's, and were left alone\n"));
        }
        super::print(&text)?;
        Ok(ExitCode::SUCCESS)
    }
}
