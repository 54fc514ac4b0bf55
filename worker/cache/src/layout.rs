//! Where things lie in a cache folder, and which files in it are ours.

use std::path::{Path, PathBuf};

use proto::Digest;

/// The folder of source clouds and split manifests.
pub const BLOBS: &str = "blobs";
/// The folder of derived entries.
pub const DERIVED: &str = "derived";

/// Where a blob lies below the root: fanned out over folders of two hex digits, as a folder of a quarter million entries
/// is slow to list.
pub fn blob(digest: Digest) -> PathBuf {
    Path::new(BLOBS).join(fanned_out(digest))
}

/// Where the entries of a kind lie below the root; `None` for kinds that are not lower-case words, which could lead
/// elsewhere.
pub fn kind(kind: &str) -> Option<PathBuf> {
    let slug = kind.replace(' ', "-");
    is_slug(&slug).then(|| Path::new(DERIVED).join(slug))
}

/// Where an entry lies below the root; `None` as for [`kind`].
pub fn derived(kind: &str, key: Digest) -> Option<PathBuf> {
    Some(self::kind(kind)?.join(fanned_out(key)))
}

fn fanned_out(digest: Digest) -> PathBuf {
    let name = digest.to_string();
    Path::new(&name[..2]).join(&name)
}

/// Whether a folder's name is that of a kind.
pub fn is_slug(name: &str) -> bool {
    !name.is_empty() && name.bytes().all(|byte| matches!(byte, b'a'..=b'z' | b'0'..=b'9' | b'-'))
}

/// Whether a folder's name is the start of the names in it.
pub fn is_fan_out(name: &str) -> bool {
    name.len() == 2 && is_hex(name)
}

/// Whether `name` is the name of a blob or an entry in the folder `start`.
pub fn is_digest(start: &str, name: &str) -> bool {
    name.len() == 64 && is_hex(name) && name.starts_with(start)
}

fn is_hex(text: &str) -> bool {
    text.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'a'..=b'f'))
}

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
}
