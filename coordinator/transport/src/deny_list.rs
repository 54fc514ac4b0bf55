//! The deny list: certificates, by fingerprint or by worker, and the token, that are no longer accepted.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};

use proto::tls::{CERTIFICATE_FILE, fingerprint, read_certificates};
use proto::{Fingerprint, Message};

use crate::certs::{DENY_FILE, WORKERS_FOLDER, is_worker_name};

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
///
/// A list that is missing, empty, unreadable or not understood in full lifts no denial: what it adds is added, and what
/// was denied stays so.
pub struct DenyList {
    folder: PathBuf,
    /// What was read last, or why nothing was.
    seen: Result<Vec<u8>, io::ErrorKind>,
    in_force: Denied,
}

impl DenyList {
    /// The list of this folder, with what it denies.
    ///
    /// # Errors
    /// What is wrong with it: there is no list before it that could hold.
    pub fn open(folder: &Path) -> Result<Self, String> {
        let mut list = Self { folder: folder.to_owned(), seen: Ok(Vec::new()), in_force: Denied::default() };
        let read = read(&list.path());
        list.seen = read.as_ref().map(Clone::clone).map_err(io::Error::kind);
        let (denied, doubts) = list.resolve(read);
        list.in_force = denied;
        doubts.into_iter().next().map_or(Ok(list), Err)
    }

    /// Who is denied.
    pub fn in_force(&self) -> Denied {
        self.in_force.clone()
    }

    /// Who is denied now, if the file is another than at the last look.
    pub fn look(&mut self) -> Option<Denied> {
        let read = read(&self.path());
        let seen = read.as_ref().map(Clone::clone).map_err(io::Error::kind);
        if self.seen == seen {
            return None;
        }
        self.seen = seen;
        let (mut denied, doubts) = self.resolve(read);
        if !doubts.is_empty() {
            denied.certificates.extend(&self.in_force.certificates);
            denied.token |= self.in_force.token;
            let (path, doubts) = (self.path(), doubts.join("; "));
            tracing::warn!("{}: {doubts}; whoever was denied stays denied", path.display());
        }
        self.in_force = denied;
        Some(self.in_force())
    }

    fn path(&self) -> PathBuf {
        self.folder.join(DENY_FILE)
    }

    /// Whom the bytes deny, and what of them is not understood. Workers are known by the certificates in their folders.
    fn resolve(&self, read: io::Result<Vec<u8>>) -> (Denied, Vec<String>) {
        let bytes = match read {
            // What is left of a file that was cut off, or that an editor is about to write.
            Ok(bytes) if bytes.is_empty() => {
                return (Denied::default(), vec!["got an empty file".to_owned()]);
            }
            Ok(bytes) => bytes,
            Err(error) => return (Denied::default(), vec![format!("cannot be read, got {error}")]),
        };
        let Lines { fingerprints: mut certificates, workers, token, unknown } =
            parse(&String::from_utf8_lossy(&bytes));
        let mut doubts = Vec::new();
        if let [first, others @ ..] = &unknown[..] {
            let others =
                if others.is_empty() { String::new() } else { format!(" and {} more", others.len()) };
            doubts.push(format!(
                "each line must be a fingerprint, a worker's name or token, got {first}{others}"
            ));
        }
        for worker in workers {
            let certificate = self.folder.join(WORKERS_FOLDER).join(&worker).join(CERTIFICATE_FILE);
            match read_certificates(&certificate) {
                Ok(chain) => certificates.extend(chain.first().map(fingerprint)),
                Err(error) => {
                    let error = Message::of(&error).what;
                    doubts.push(format!("{worker} is not known by its name: {error}: write its fingerprint"));
                }
            }
        }
        (Denied { certificates, token }, doubts)
    }
}

/// Why nobody more is denied.
#[derive(Debug, thiserror::Error)]
#[error("{path}: cannot be used, got {source}\ncheck permissions and free space, or write the line by hand")]
pub struct DenyError {
    path: PathBuf,
    source: io::Error,
}

/// Adds a certificate to the deny list of a folder, which there must be, with a comment of one line. Gives the list.
///
/// # Errors
/// If the list cannot be read or written; then it is as it was.
pub fn deny(folder: &Path, certificate: &Fingerprint, comment: &str) -> Result<PathBuf, DenyError> {
    let path = folder.join(DENY_FILE);
    let add = || {
        let mut bytes = read(&path)?;
        if parse(&String::from_utf8_lossy(&bytes)).fingerprints.contains(certificate) {
            return Ok(());
        }
        if bytes.last().is_some_and(|&last| last != b'\n') {
            bytes.push(b'\n');
        }
        let comment = comment.replace(['\n', '\r'], " ");
        bytes.extend(format!("{certificate} # {comment}\n").bytes());
        atomic::write(&path, &bytes)
    };
    match add() {
        Ok(()) => Ok(path),
        Err(source) => Err(DenyError { path, source }),
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

    /// A folder of certificates with one worker, lab-1, and the fingerprint of its certificate.
    fn site() -> (tempfile::TempDir, PathBuf, Fingerprint) {
        let parent = tempfile::tempdir().unwrap();
        let folder = parent.path().join("tls");
        make_folder(&folder, &Site { hosts: vec![], port: 7700 }, &validity(1)).unwrap();
        let worker = add_worker(&folder, "lab-1", &validity(1)).unwrap();
        let print = fingerprint(&read_certificates(&worker.join(CERTIFICATE_FILE)).unwrap()[0]);
        (parent, folder, print)
    }

    #[test]
    fn a_list_is_told_when_it_changes() {
        let (_parent, folder, print) = site();
        let mut list = DenyList::open(&folder).unwrap();
        assert_eq!((list.in_force(), list.look()), (Denied::default(), None), "a new folder denies nobody");
        let path = folder.join(DENY_FILE);
        let lab_1 = Denied { certificates: [print].into(), token: false };
        fs::write(&path, "lab-1\n").unwrap();
        assert_eq!(list.look(), Some(lab_1.clone()));
        assert_eq!((list.in_force(), list.look()), (lab_1, None));
        fs::write(&path, "token\n").unwrap();
        assert_eq!(list.look(), Some(Denied { certificates: [].into(), token: true }), "lab-1 is lifted");
        fs::write(&path, "# nobody\n").unwrap();
        assert_eq!(list.look(), Some(Denied::default()));
    }

    #[test]
    fn a_list_that_is_missing_or_garbled_lifts_no_denial_and_is_none_to_start_with() {
        let (_parent, folder, print) = site();
        let path = folder.join(DENY_FILE);
        let (more, long) = (Fingerprint([0xab; 32]), vec![b'#'; MAX_BYTES as usize + 1]);
        let cut_off = &print.to_string()[1..];
        let spoilt: [(&str, Option<&[u8]>); 7] = [
            ("a file that is gone", None),
            ("an empty file", Some(b"")),
            ("a worker that is not known", Some(b"lab-2\n")),
            ("a fingerprint cut off", Some(cut_off.as_bytes())),
            ("no text", Some(&[0, 159, 146, 150, b'\n'])),
            ("a line that is nothing", Some(b"# here\n../../etc\n")),
            ("too much", Some(&long)),
        ];
        for (what, bytes) in spoilt {
            fs::write(&path, "lab-1\ntoken\n").unwrap();
            let mut list = DenyList::open(&folder).unwrap();
            let denied = list.in_force();
            assert_eq!(denied, Denied { certificates: [print].into(), token: true });
            match bytes {
                Some(bytes) => fs::write(&path, bytes).unwrap(),
                None => fs::remove_file(&path).unwrap(),
            }
            assert_eq!(list.look(), Some(denied.clone()), "{what}");
            assert_eq!(list.look(), None, "{what}: said once");
            assert!(DenyList::open(&folder).is_err(), "{what}");
            // What is readable in it is denied as well.
            fs::write(&path, format!("{more}\n???\n")).unwrap();
            let both = Denied { certificates: [print, more].into(), token: true };
            assert_eq!(list.look(), Some(both), "{what}");
            fs::write(&path, format!("{more}\n")).unwrap();
            assert_eq!(list.look(), Some(Denied { certificates: [more].into(), token: false }), "{what}");
        }
        fs::remove_file(&path).unwrap();
        fs::create_dir(&path).unwrap();
        assert!(DenyList::open(&folder).is_err(), "a folder");
    }

    #[test]
    fn a_certificate_is_added_once_and_what_else_is_denied_stays_so() {
        let (_parent, folder, print) = site();
        let path = folder.join(DENY_FILE);
        fs::write(&path, "token").unwrap();
        for _ in 0..2 {
            assert_eq!(deny(&folder, &print, "by jo:\nstolen").unwrap(), path);
        }
        assert_eq!(fs::read_to_string(&path).unwrap(), format!("token\n{print} # by jo: stolen\n"));
        let both = Denied { certificates: [print].into(), token: true };
        assert_eq!(DenyList::open(&folder).unwrap().in_force(), both);
        fs::remove_file(&path).unwrap();
        let error = deny(&folder, &print, "").unwrap_err().to_string();
        assert!(error.contains("deny: cannot be used, got No such file"), "{error}");
        assert!(!path.exists(), "a list that is missing is not made: it may have denied others");
    }

    proptest! {
        #[test]
        fn any_text_is_a_list(text in "\\PC*|([a-f0-9:]{60,100}\n)*") {
            let lines = parse(&text);
            prop_assert!(lines.workers.iter().all(|name| is_worker_name(name)));
        }
    }
}
