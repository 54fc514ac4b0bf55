//! The address of a bucket that machines share, and the names of objects in it.

use std::fmt;
use std::str::FromStr;

use proto::{BLOB_KIND, Digest};

use crate::layout;

/// `s3://BUCKET/PREFIX`; the prefix may be missing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BucketUrl {
    /// Name of the bucket.
    pub bucket: String,
    /// What the names of all objects begin with, without a slash at either end; may be empty.
    pub prefix: String,
}

/// A text that is no address of a bucket.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("shared bucket: {what}, got {got}\nwrite it like s3://lab-cache/descry")]
pub struct InvalidBucketUrl {
    what: &'static str,
    got: String,
}

impl FromStr for BucketUrl {
    type Err = InvalidBucketUrl;

    fn from_str(text: &str) -> Result<Self, InvalidBucketUrl> {
        let wrong = |what| InvalidBucketUrl { what, got: text.to_owned() };
        let rest = text.strip_prefix("s3://").ok_or_else(|| wrong("must begin with s3://"))?;
        let (bucket, prefix) = rest.split_once('/').unwrap_or((rest, ""));
        let of_name = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || b".-".contains(&byte);
        if !(3..=63).contains(&bucket.len()) || !bucket.bytes().all(of_name) {
            return Err(wrong("the name of a bucket is 3 to 63 of a-z, 0-9, '.' and '-'"));
        }
        let prefix = prefix.strip_suffix('/').unwrap_or(prefix);
        let of_part = |byte: u8| byte.is_ascii_alphanumeric() || b"._-".contains(&byte);
        // Nothing that would be written otherwise in a URL, so that what is signed is what is asked for.
        let is_part = |part: &str| {
            !part.is_empty() && part.bytes().all(of_part) && part.bytes().any(|byte| byte != b'.')
        };
        if !prefix.is_empty() && !prefix.split('/').all(is_part) {
            return Err(wrong("a prefix is words of A-Z, a-z, 0-9, '.', '_' and '-', with '/' between them"));
        }
        Ok(Self { bucket: bucket.to_owned(), prefix: prefix.to_owned() })
    }
}

/// What was found in a bucket when it was pruned.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pruned {
    /// Objects of ours that are old, and their bytes.
    pub old: (u64, u64),
    /// Objects of ours that stay, and their bytes.
    pub kept: (u64, u64),
    /// Objects below the prefix that are not ours.
    pub foreign: u64,
}

impl fmt::Display for BucketUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let slash = if self.prefix.is_empty() { "" } else { "/" };
        write!(f, "s3://{}{slash}{}", self.bucket, self.prefix)
    }
}

impl BucketUrl {
    /// The whole name of the object that holds an entry of a kind, or a blob ([`BLOB_KIND`]). As in a cache folder, below the
    /// prefix; `None` for kinds that are not lower-case words.
    pub fn object(&self, kind: &str, key: Digest) -> Option<String> {
        let path = if kind == BLOB_KIND { layout::blob(key) } else { layout::derived(kind, key)? };
        let slash = if self.prefix.is_empty() { "" } else { "/" };
        Some(format!("{}{slash}{}", self.prefix, path.display()))
    }

    /// Whether an object is one that [`BucketUrl::object`] names: whatever else lies in a bucket is somebody else's.
    pub fn is_ours(&self, object: &str) -> bool {
        let below = match self.prefix.as_str() {
            "" => Some(object),
            prefix => object.strip_prefix(prefix).and_then(|rest| rest.strip_prefix('/')),
        };
        let parts: Vec<&str> = below.map(|below| below.split('/').collect()).unwrap_or_default();
        match parts[..] {
            [layout::BLOBS, start, name] => layout::is_fan_out(start) && layout::is_digest(start, name),
            [layout::DERIVED, kind, start, name] => {
                layout::is_slug(kind) && layout::is_fan_out(start) && layout::is_digest(start, name)
            }
            _ => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_read_and_shown() {
        for (text, bucket, prefix) in [
            ("s3://lab", "lab", ""),
            ("s3://lab-1.x/", "lab-1.x", ""),
            ("s3://lab/descry", "lab", "descry"),
            ("s3://lab/a/B_2/c.d/", "lab", "a/B_2/c.d"),
        ] {
            let url: BucketUrl = text.parse().unwrap();
            assert_eq!((url.bucket.as_str(), url.prefix.as_str()), (bucket, prefix), "{text}");
            assert_eq!(url.to_string(), text.trim_end_matches('/'));
        }
        for text in [
            "",
            "lab",
            "s3:/lab",
            "s3://",
            "s3://ab",
            "s3://Lab",
            "s3://la b",
            "s3://lab//x",
            "s3://lab/..",
            "s3://lab/a/../b",
            "s3://lab/a%20b",
            "s3://lab/a b",
            "s3://lab/x?y",
            "http://lab/x",
            "s3://key:secret@lab/x",
        ] {
            let error = text.parse::<BucketUrl>().unwrap_err().to_string();
            assert!(error.starts_with("shared bucket: ") && error.contains("got "), "{error}");
        }
    }

    #[test]
    fn names_are_those_of_a_folder_and_known_again() {
        let key = Digest([0xab; 32]);
        for prefix in ["", "a/b"] {
            let url = BucketUrl { bucket: "lab".to_owned(), prefix: prefix.to_owned() };
            let below =
                |path: &str| if prefix.is_empty() { path.to_owned() } else { format!("{prefix}/{path}") };
            let names = [url.object("", key).unwrap(), url.object("prepared cloud 2", key).unwrap()];
            assert_eq!(names[0], below(&format!("blobs/ab/{key}")));
            assert_eq!(names[1], below(&format!("derived/prepared-cloud-2/ab/{key}")));
            assert!(names.iter().all(|name| url.is_ours(name)), "{names:?}");
            assert_eq!(url.object("../x", key), None);
            let foreign = [
                below("blobs/cd/notes.txt"),
                below(&format!("blobs/cd/{key}")),
                below(&format!("other/ab/{key}")),
                below(&format!("derived/Prepared/ab/{key}")),
                below(&format!("derived/a/b/ab/{key}")),
                format!("x{}", names[0]),
                format!("elsewhere/blobs/ab/{key}"),
            ];
            assert!(!foreign.iter().any(|name| url.is_ours(name)), "{foreign:?}");
        }
    }
}
