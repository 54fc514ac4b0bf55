//! The deny list: certificates, by fingerprint or by worker, and the token, that are no longer accepted.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};

use proto::tls::{CERTIFICATE_FILE, fingerprint, read_certificates};
use proto::{Fingerprint, Message};

use crate::certs::{WORKERS_FOLDER, is_worker_name};

/// Its file in the folder of certificates.
pub const DENY_FILE: &str = "deny";
/// The line that denies the token.
const TOKEN_LINE: &str = "token";
/// A longer list is not read.
const MAX_BYTES: u64 = 1 << 20;

/// Who is not let in any more.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Denied {
    /// Certificates.
    pub certificates: BTreeSet<Fingerprint>,
    /// Whoever shows the token.
    pub token: bool,
}

/// A deny list as it is written: a fingerprint, a worker's name or `token` on each line; `#` begins a comment.
#[derive(Debug, Default, PartialEq, Eq)]
struct Lines {
    fingerprints: BTreeSet<Fingerprint>,
    workers: BTreeSet<String>,
    token: bool,
    /// Lines that are none of these.
    unknown: Vec<String>,
}

fn parse(text: &str) -> Lines {
    let mut lines = Lines::default();
    for line in text.lines() {
        let line = line.split('#').next().unwrap_or_default().trim();
        if line == TOKEN_LINE {
            lines.token = true;
        } else if let Ok(fingerprint) = line.parse() {
            lines.fingerprints.insert(fingerprint);
        } else if is_worker_name(line) {
            lines.workers.insert(line.to_owned());
        } else if !line.is_empty() {
            lines.unknown.push(line.escape_debug().take(80).collect());
        }
    }
    lines
}

/// The deny list of a folder of certificates, read again whenever its bytes change.
pub struct DenyList {
    folder: PathBuf,
    /// What was read last, or why nothing was.
    seen: Option<Result<Vec<u8>, io::ErrorKind>>,
}

impl DenyList {
    /// The list of this folder, not read yet.
    pub fn new(folder: &Path) -> Self {
        Self { folder: folder.to_owned(), seen: None }
    }

    /// Whether the list of this folder, if there is one, can be read: at first there is none before it that could hold.
    pub fn check(folder: &Path) -> io::Result<()> {
        match read(&folder.join(DENY_FILE)) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
            read => read.map(drop),
        }
    }

    /// The list, if it is another than at the last look. One that cannot be read leaves the last in force.
    pub fn look(&mut self) -> Option<Denied> {
        let path = self.folder.join(DENY_FILE);
        let read = match read(&path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(Vec::new()),
            other => other,
        };
        let seen = read.as_ref().map(Clone::clone).map_err(io::Error::kind);
        if self.seen.as_ref() == Some(&seen) {
            return None;
        }
        self.seen = Some(seen);
        match read {
            Ok(bytes) => Some(self.resolve(parse(&String::from_utf8_lossy(&bytes)))),
            Err(error) => {
                tracing::error!("{}: cannot be read, got {error}; the list before holds", path.display());
                None
            }
        }
    }

    /// Workers are known by the certificates in their folders.
    fn resolve(&self, lines: Lines) -> Denied {
        let path = self.folder.join(DENY_FILE);
        for line in lines.unknown {
            tracing::error!(
                "{}: must be a fingerprint, a worker's name or token, got {line}",
                path.display()
            );
        }
        let mut certificates = lines.fingerprints;
        for worker in lines.workers {
            let certificate = self.folder.join(WORKERS_FOLDER).join(&worker).join(CERTIFICATE_FILE);
            match read_certificates(&certificate) {
                Ok(chain) => certificates.extend(chain.first().map(fingerprint)),
                Err(error) => {
                    let error = Message::of(&error).what;
                    tracing::error!(
                        "{}: {worker} is not denied: {error}; write its fingerprint",
                        path.display()
                    );
                }
            }
        }
        Denied { certificates, token: lines.token }
    }
}

fn read(path: &Path) -> io::Result<Vec<u8>> {
    if !fs::metadata(path)?.is_file() {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "something that is no file")); // a pipe would be waited for
    }
    let mut bytes = Vec::new();
    File::open(path)?.take(MAX_BYTES + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > MAX_BYTES {
        return Err(io::Error::new(io::ErrorKind::FileTooLarge, "more than 1 MiB"));
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use proptest::prelude::*;

    use super::*;
    use crate::certs::{Site, add_worker, make_folder, validity};

    #[test]
    fn lines_are_fingerprints_names_the_token_and_comments() {
        let print = Fingerprint([0xab; 32]);
        let colons =
            print.to_string().to_uppercase().as_bytes().chunks(2).fold(String::new(), |text, pair| {
                format!("{text}{}{}", if text.is_empty() { "" } else { ":" }, String::from_utf8_lossy(pair))
            });
        let lines = parse(&format!("# lost laptops\n\n {colons} # of lab-1\nlab-2\ntoken\n../../etc\n"));
        assert_eq!(lines.fingerprints, [print].into());
        assert_eq!(lines.workers, ["lab-2".to_owned()].into());
        assert!(lines.token);
        assert_eq!(lines.unknown, ["../../etc"]);
    }

    #[test]
    fn a_list_is_told_when_it_changes_and_kept_when_it_cannot_be_read() {
        let parent = tempfile::tempdir().unwrap();
        let folder = parent.path().join("tls");
        make_folder(&folder, &Site { hosts: vec![], port: 7700 }, &validity(1)).unwrap();
        let worker = add_worker(&folder, "lab-1", &validity(1)).unwrap();
        let print = fingerprint(&read_certificates(&worker.join(CERTIFICATE_FILE)).unwrap()[0]);
        let mut list = DenyList::new(&folder);
        assert_eq!(list.look(), Some(Denied::default()), "no list is an empty one");
        assert_eq!(list.look(), None);
        let path = folder.join(DENY_FILE);
        fs::write(&path, "lab-1\nnobody\n").unwrap();
        assert_eq!(list.look(), Some(Denied { certificates: [print].into(), token: false }));
        assert_eq!(list.look(), None);
        fs::write(&path, vec![b'#'; MAX_BYTES as usize + 1]).unwrap();
        assert_eq!(list.look(), None, "too long: the list before holds");
        fs::remove_file(&path).unwrap();
        assert_eq!(list.look(), Some(Denied::default()));
    }

    proptest! {
        #[test]
        fn any_text_is_a_list(text in "\\PC*|([a-f0-9:]{60,100}\n)*") {
            let lines = parse(&text);
            prop_assert!(lines.workers.iter().all(|name| is_worker_name(name)));
        }
    }
}
