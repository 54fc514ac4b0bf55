//! What a program may use of the disk and of memory: options that both programs have.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use bytesize::ByteSize;
use clap::Args;
use sysinfo::System;

use crate::bucket_url::{BucketUrl, InvalidBucketUrl};
use crate::size::parse_size;

/// Room for the cache folder unless an option says otherwise.
const DEFAULT_CACHE_SIZE: &str = "20GiB";
/// Memory where the machine does not tell how much it has: half of 4 GiB.
const FALLBACK_MEMORY: ByteSize = ByteSize::gib(2);

/// Options for the cache and for memory. None of them changes a result.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Cache and memory")]
pub struct StorageArgs {
    /// Folder that keeps clouds and what was computed from them, for example /scratch/descry; ~/.cache/descry by
    /// default
    #[arg(long, env = "DESCRY_CACHE", value_name = "DIR")]
    cache: Option<PathBuf>,
    /// Keep nothing on disk and use nothing that is kept there, the shared folder included, for example to measure
    #[arg(long)]
    no_cache: bool,
    /// Most that the cache folder may hold, for example 500MiB; what was used least recently goes first
    #[arg(long, env = "DESCRY_CACHE_SIZE", value_name = "SIZE", default_value = DEFAULT_CACHE_SIZE, value_parser = parse_size)]
    cache_size: ByteSize,
    /// Memory for prepared clouds and what is computed from them, for example 600MiB; half of what is available by
    /// default. Clouds that do not fit are read from the cache each time. Workers that share a machine should each be
    /// given their part
    #[arg(long, env = "DESCRY_MEMORY", value_name = "SIZE", value_parser = parse_size)]
    memory: Option<ByteSize>,
    /// Folder that several machines share, for example file:///mnt/descry: what one has prepared serves all. A coordinator
    /// also takes a bucket, for example s3://lab-cache/descry, and hands out URLs to its workers
    #[arg(long, env = "DESCRY_SHARED_CACHE", value_name = "URL")]
    shared: Option<Shared>,
    /// Only read what machines share, and change nothing there, for example where others own it
    #[arg(long, requires = "shared")]
    shared_read_only: bool,
}

/// What several machines share.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Shared {
    Folder(PathBuf),
    Bucket(BucketUrl),
}

impl FromStr for Shared {
    type Err = String;

    fn from_str(url: &str) -> Result<Self, String> {
        if url.starts_with("s3://") {
            return url.parse().map(Self::Bucket).map_err(|error: InvalidBucketUrl| error.to_string());
        }
        shared_folder(url).map(Self::Folder)
    }
}

/// What [`StorageArgs`] come to on this machine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Storage {
    /// The cache folder, if anything is kept.
    pub cache: Option<PathBuf>,
    /// Most bytes in the cache folder.
    pub cache_size: ByteSize,
    /// Memory for prepared clouds and what is computed from them.
    pub memory: ByteSize,
    /// The folder that machines share, if there is one.
    pub shared: Option<PathBuf>,
    /// The bucket that machines share, if there is one.
    pub bucket: Option<BucketUrl>,
    /// Whether both are only read.
    pub shared_read_only: bool,
}

impl StorageArgs {
    /// The settings with all defaults filled in.
    pub fn resolve(&self) -> Storage {
        let cache = (!self.no_cache).then(|| self.cache.clone().unwrap_or_else(default_cache));
        let (shared, bucket) = match self.shared.clone().filter(|_| !self.no_cache) {
            None => (None, None),
            Some(Shared::Folder(folder)) => (Some(folder), None),
            Some(Shared::Bucket(url)) => (None, Some(url)),
        };
        Storage {
            cache,
            cache_size: self.cache_size,
            memory: self.memory.unwrap_or_else(default_memory),
            shared,
            bucket,
            shared_read_only: self.shared_read_only,
        }
    }
}

impl Storage {
    /// Nothing on disk, and this much memory.
    pub fn in_memory(memory: ByteSize) -> Self {
        Self {
            cache: None,
            cache_size: ByteSize(0),
            memory,
            shared: None,
            bucket: None,
            shared_read_only: false,
        }
    }
}

/// `$XDG_CACHE_HOME/descry`, else `~/.cache/descry`, else a folder for temporary files.
fn default_cache() -> PathBuf {
    let base = std::env::var_os("XDG_CACHE_HOME").filter(|dir| !dir.is_empty()).map(PathBuf::from);
    let home = || std::env::home_dir().map(|home| home.join(".cache"));
    base.or_else(home).unwrap_or_else(std::env::temp_dir).join("descry")
}

fn shared_folder(url: &str) -> Result<PathBuf, String> {
    let wrong = |what: &str| {
        format!(
            "shared folder: {what}, got {url}\nwrite it like file:///mnt/descry, or s3://lab-cache/descry for a bucket"
        )
    };
    let path = url.strip_prefix("file://").ok_or_else(|| wrong("must begin with file://"))?;
    // A percent sign could be meant as an escape or as itself; neither is guessed.
    if path.contains(['%', '?', '#', '\0']) {
        return Err(wrong("must be a plain path without %, ? and #"));
    }
    let path = Path::new(path);
    if path.is_absolute() {
        Ok(path.to_owned())
    } else {
        Err(wrong("must be an absolute path on this machine"))
    }
}

/// Half of what this process may still use: of the machine, and of a container that grants less.
pub fn default_memory() -> ByteSize {
    let mut system = System::new();
    system.refresh_memory();
    let granted = system.cgroup_limits().map(|limits| limits.total_memory);
    half(system.available_memory(), granted)
}

/// Half of the lesser of the two, in bytes; neither is known if `available` is 0 and nothing is granted.
fn half(available: u64, granted: Option<u64>) -> ByteSize {
    let available = Some(available).filter(|&bytes| bytes > 0);
    let least = available.into_iter().chain(granted).min();
    least.map_or(FALLBACK_MEMORY, |bytes| ByteSize(bytes / 2))
}

#[cfg(test)]
mod tests {
    use clap::Parser as _;

    use super::*;

    #[derive(clap::Parser)]
    struct Program {
        #[command(flatten)]
        storage: StorageArgs,
    }

    fn resolve(args: &[&str]) -> Storage {
        let args = ["program"].iter().chain(args);
        Program::try_parse_from(args).map_err(|error| error.to_string()).unwrap().storage.resolve()
    }

    #[test]
    fn options_are_resolved() {
        let args = ["--cache", "/c", "--cache-size", "1MiB", "--memory", "2GiB", "--shared", "file:///mnt/d"];
        let storage = resolve(&args);
        assert_eq!(storage.cache.as_deref(), Some(Path::new("/c")));
        assert_eq!((storage.cache_size.as_u64(), storage.memory.as_u64()), (1 << 20, 2 << 30));
        assert_eq!(storage.shared.as_deref(), Some(Path::new("/mnt/d")));
        let nothing = resolve(&[&args[..], &["--no-cache"]].concat());
        assert_eq!(nothing, Storage { cache: None, shared: None, ..storage });
        let of_bucket = resolve(&["--shared", "s3://lab/descry", "--shared-read-only"]);
        assert_eq!((of_bucket.shared, of_bucket.shared_read_only), (None, true));
        assert_eq!(of_bucket.bucket.unwrap().to_string(), "s3://lab/descry");
        assert_eq!(resolve(&["--shared", "s3://lab/descry", "--no-cache"]).bucket, None);
        assert!(Program::try_parse_from(["program", "--shared-read-only"]).is_err());
    }

    #[test]
    fn only_absolute_paths_are_shared_folders() {
        assert_eq!(shared_folder("file:///mnt/descry"), Ok(PathBuf::from("/mnt/descry")));
        for url in ["/mnt/descry", "file://mnt", "s3://bucket", "http://x/y", "file:///a%20b", "file://", ""]
        {
            let message = shared_folder(url).unwrap_err();
            assert!(message.starts_with("shared folder: "), "{message}");
            assert!(message.contains(&format!("got {url}\nwrite it like file:///mnt/descry")), "{message}");
        }
    }

    #[test]
    fn memory_is_half_of_what_machine_and_container_leave() {
        for (available, granted, expected) in [
            (8 << 30, None, 4 << 30),
            (8 << 30, Some(16 << 30), 4 << 30),
            (8 << 30, Some(1 << 30), 1 << 29),
            (0, Some(1 << 30), 1 << 29),
            (0, None, 2 << 30),
        ] {
            assert_eq!(half(available, granted).as_u64(), expected, "{available}, {granted:?}");
        }
    }

    #[test]
    fn this_machine_tells_its_memory() {
        let mut system = System::new();
        system.refresh_memory();
        let memory = resolve(&[]).memory.as_u64();
        assert!((1 << 20..=system.total_memory() / 2).contains(&memory), "{memory}");
    }
}
