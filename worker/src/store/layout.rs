//! Where things lie in a cache folder, and which files in it are ours.

use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use proto::Digest;

/// The folder of source clouds and split manifests.
pub const BLOBS: &str = "blobs";
/// The folder of derived entries.
pub const DERIVED: &str = "derived";

/// Where a blob lies below the root: spread over folders of two hex digits, as a folder of a quarter million entries
/// is slow to list.
pub fn blob(digest: Digest) -> PathBuf {
    Path::new(BLOBS).join(spread(digest))
}

/// Where an entry lies below the root; `None` for kinds that are not lower-case words, which could lead elsewhere.
pub fn derived(kind: &str, key: Digest) -> Option<PathBuf> {
    let slug = kind.replace(' ', "-");
    is_slug(&slug).then(|| Path::new(DERIVED).join(slug).join(spread(key)))
}

fn spread(digest: Digest) -> PathBuf {
    let name = digest.to_string();
    Path::new(&name[..2]).join(&name)
}

/// Whether a folder's name is that of a kind.
pub fn is_slug(name: &str) -> bool {
    !name.is_empty() && name.bytes().all(|byte| matches!(byte, b'a'..=b'z' | b'0'..=b'9' | b'-'))
}

/// Whether a folder's name is the start of the names in it.
pub fn is_spread(name: &str) -> bool {
    name.len() == 2 && is_hex(name)
}

/// Whether `name` is the name of a blob or an entry in the folder `spread`.
pub fn is_digest(spread: &str, name: &str) -> bool {
    name.len() == 64 && is_hex(name) && name.starts_with(spread)
}

fn is_hex(text: &str) -> bool {
    text.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'a'..=b'f'))
}

/// How temporary files of this process begin: host and process tell whether whoever writes one is still there.
pub fn temporary_prefix() -> String {
    format!("tmp-{}-{}-", *HOST, std::process::id())
}

/// A temporary file's host and process, from its name.
pub fn temporary(name: &str) -> Option<Writer<'_>> {
    let (host, rest) = name.strip_prefix("tmp-")?.split_once('-')?;
    let (process, rest) = rest.split_once('-')?;
    let process: u32 = process.parse().ok()?;
    let ours = rest.len() == TEMPORARY_DIGITS && rest.bytes().all(|byte| byte.is_ascii_alphanumeric());
    (host.len() == 16 && is_hex(host) && ours).then_some(Writer { host, process })
}

/// Random characters at the end of a temporary file's name.
pub const TEMPORARY_DIGITS: usize = 12;

/// Who writes a temporary file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Writer<'a> {
    host: &'a str,
    process: u32,
}

impl Writer<'_> {
    /// Whether it is known to have ended; unknown for processes of other machines that use the same folder.
    pub fn is_gone(self) -> bool {
        let processes = Path::new("/proc/self");
        self.host == *HOST
            && processes.exists()
            && !Path::new("/proc").join(self.process.to_string()).exists()
    }
}

/// Sixteen hex digits that differ between machines with different names.
static HOST: LazyLock<String> = LazyLock::new(|| {
    let name = hostname::get().unwrap_or_default();
    Digest::of(name.as_encoded_bytes()).to_string()[..16].to_owned()
});

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_never_lead_elsewhere() {
        let key = Digest([0xab; 32]);
        let expected = format!("derived/prepared-cloud/ab/{key}");
        assert_eq!(derived("prepared cloud", key), Some(PathBuf::from(expected)));
        for kind in ["", "..", "../blobs", "a/b", "A", "a.b", "a\0"] {
            assert_eq!(derived(kind, key), None, "{kind}");
        }
    }

    #[test]
    fn temporary_files_name_their_writer() {
        let name = format!("{}{}", temporary_prefix(), "x".repeat(TEMPORARY_DIGITS));
        assert!(!temporary(&name).unwrap().is_gone());
        let gone = name.replace(&format!("-{}-", std::process::id()), "-4294967295-");
        assert!(temporary(&gone).unwrap().is_gone());
        let elsewhere = gone.replace(&*HOST, "0123456789abcdef");
        assert!(!temporary(&elsewhere).unwrap().is_gone());
        for name in ["tmp", "tmp-1-2-3", "tmp-0123456789abcdef-1-", "notes.txt", &name[..name.len() - 1]] {
            assert_eq!(temporary(name), None, "{name}");
        }
    }
}
