//! Certificates and token of a coordinator: a folder of files that lets its own workers in, and nobody else.
//!
//! The folder holds `ca.pem` and `ca.key`, the coordinator's `cert.pem` (with the CA at its end) and `key.pem`, `token`,
//! `join` (the join address with the token), the list `deny`, and for each worker with a certificate `workers/NAME/`: `cert.pem`,
//! `key.pem` and a `join` without token. What is secret only its owner can read.

use std::fs::{self, DirBuilder};
use std::io;
use std::ops::Range;
use std::os::unix::fs::DirBuilderExt as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use atomic::{Access, NewFolder};
use proto::tls::{CERTIFICATE_FILE, KEY_FILE, TlsFilesError, fingerprint, read_certificates};
use proto::{JoinAddress, Token, Trust};
use rcgen::{
    BasicConstraints, CertificateParams, DnType, ExtendedKeyUsagePurpose, IsCa, Issuer, KeyPair,
    KeyUsagePurpose,
};

/// The CA's certificate.
pub const CA_FILE: &str = "ca.pem";
/// The CA's private key: only needed to make more certificates.
const CA_KEY_FILE: &str = "ca.key";
/// The token.
pub const TOKEN_FILE: &str = "token";
/// The join address.
pub const JOIN_FILE: &str = "join";
/// The deny list.
pub const DENY_FILE: &str = "deny";
/// A deny list that denies nobody.
const NOBODY: &str =
    "# nobody; to deny: a worker's name, the fingerprint of a certificate, or token, one on a line\n";
/// Where the workers' certificates are, a folder each.
pub const WORKERS_FOLDER: &str = "workers";

/// Clocks may differ by this much.
const CLOCK_SKEW: Duration = Duration::from_secs(24 * 3600);

/// Why there are no certificates.
#[derive(Debug, thiserror::Error)]
pub enum CertsError {
    /// A file or folder.
    #[error(
        "{path}: cannot be used, got {source}\ncheck permissions and free space, or choose another folder"
    )]
    File {
        /// Which one.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// A file of an earlier use.
    #[error(transparent)]
    Tls(#[from] TlsFilesError),
    /// What is there is kept.
    #[error(
        "{0}: is there already\nremove it first, or choose another name; a lost certificate belongs in the deny list"
    )]
    Exists(PathBuf),
    /// A folder of something else.
    #[error("{0}: must be empty or made by `coordinator certs`, got other files\nchoose another folder")]
    Foreign(PathBuf),
    /// The coordinator's certificate is made once.
    #[error(
        "--host: the coordinator's certificate is there already, got {0}\nmake another folder with all names"
    )]
    HostsAreSet(String),
    /// A worker's name.
    #[error(
        "--worker: must be 1 to 64 letters, digits, dots, hyphens and underscores, got {0}\nchoose another name"
    )]
    WorkerName(String),
    /// A host's name.
    #[error("--host {host}: {source}")]
    Host {
        /// As given.
        host: String,
        /// Why.
        source: proto::InvalidJoinAddress,
    },
    /// Anything the cryptography says.
    #[error("certificates: cannot be made, got {0}\nplease report this")]
    Cryptography(#[from] rcgen::Error),
}

/// What the coordinator's certificate is made for.
#[derive(Clone, Debug)]
pub struct Site {
    /// Names and addresses by which workers reach it; the first is in the join address.
    pub hosts: Vec<String>,
    /// The port of the join address.
    pub port: u16,
}

/// Fills a folder that has no certificates yet, all at once.
pub fn make_folder(folder: &Path, site: &Site, valid: &Range<SystemTime>) -> Result<(), CertsError> {
    let failed = |source| CertsError::File { path: folder.to_owned(), source };
    if fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_some()) {
        return Err(CertsError::Foreign(folder.to_owned()));
    }
    let new = NewFolder::beside(folder, Access::Owner).map_err(failed)?;
    let authority = Authority::new(valid)?;
    let write = |name: &str, text: &str| write_secret(&new, name, text);
    write(CA_FILE, &authority.pem)?;
    write(CA_KEY_FILE, &authority.issuer.key().serialize_pem())?;
    let hosts = if site.hosts.is_empty() { vec![crate::host_name()] } else { site.hosts.clone() };
    let here = ["localhost", "127.0.0.1", "::1"].map(str::to_owned);
    let names = hosts.iter().filter(|host| !here.contains(host)).cloned().chain(here.clone());
    let certified = authority.certify(&Subject::Coordinator(names.collect()), valid)?;
    write(CERTIFICATE_FILE, &certified.chain)?;
    write(KEY_FILE, &certified.key)?;
    let token = Token::new(rand::random());
    write(TOKEN_FILE, &format!("{}\n", token.reveal()))?;
    let host = hosts.into_iter().next().unwrap_or_else(crate::host_name);
    let bracketed = if host.contains(':') { format!("[{host}]") } else { host.clone() };
    let address: Result<JoinAddress, _> = format!("http://{bracketed}:{}", site.port).parse();
    let mut address = address.map_err(|source| CertsError::Host { host, source })?;
    let ca = read_certificates(&new.path().join(CA_FILE))?;
    address.trust = Some(Trust { ca: fingerprint(&ca[0]), token: Some(token) });
    write(JOIN_FILE, &format!("{}\n", address.reveal()))?;
    write(DENY_FILE, NOBODY)?;
    new.commit(folder).map_err(failed)
}

/// Adds a worker's certificate to a folder of [`make_folder`]; returns its own folder, which is all that it needs.
pub fn add_worker(folder: &Path, name: &str, valid: &Range<SystemTime>) -> Result<PathBuf, CertsError> {
    if !is_worker_name(name) {
        return Err(CertsError::WorkerName(name.to_owned()));
    }
    let workers = folder.join(WORKERS_FOLDER);
    let failed = |source| CertsError::File { path: workers.clone(), source };
    DirBuilder::new().recursive(true).mode(0o700).create(&workers).map_err(failed)?;
    let place = workers.join(name);
    if place.exists() {
        return Err(CertsError::Exists(place));
    }
    let new = NewFolder::beside(&place, Access::Owner).map_err(failed)?;
    let certified = Authority::read(folder)?.certify(&Subject::Worker(name.to_owned()), valid)?;
    write_secret(&new, CERTIFICATE_FILE, &certified.chain)?;
    write_secret(&new, KEY_FILE, &certified.key)?;
    let mut address = join_address(folder)?;
    if let Some(trust) = &mut address.trust {
        trust.token = None;
    }
    write_secret(&new, JOIN_FILE, &format!("{}\n", address.reveal()))?;
    new.commit(&place).map_err(failed)?;
    Ok(place)
}

/// Whether a folder has certificates already.
pub fn is_made(folder: &Path) -> bool {
    folder.join(CA_FILE).exists()
}

/// From a day ago to `days` from now.
pub fn validity(days: u32) -> Range<SystemTime> {
    let now = SystemTime::now();
    now - CLOCK_SKEW..now + Duration::from_secs(u64::from(days) * 24 * 3600)
}

/// Names that can be folders and cannot leave theirs.
pub fn is_worker_name(name: &str) -> bool {
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    // In the deny list, these would mean something else.
    let taken = name == "token" || name.parse::<proto::Fingerprint>().is_ok();
    let sound = name.chars().all(plain) && !name.starts_with('.');
    (1..=proto::MAX_NAME_BYTES).contains(&name.len()) && sound && !taken
}

/// The join address of a folder, token included.
pub fn join_address(folder: &Path) -> Result<JoinAddress, CertsError> {
    let path = folder.join(JOIN_FILE);
    let text = read_small(&path)?;
    text.trim().parse().map_err(|source| CertsError::File { path, source: io::Error::other(source) })
}

/// The token of a folder; `None` if its file was removed, so that only certificates let workers in.
pub fn token(folder: &Path) -> Result<Option<Token>, CertsError> {
    let path = folder.join(TOKEN_FILE);
    if !path.exists() {
        return Ok(None);
    }
    let token = read_small(&path)?.trim().parse();
    token
        .map(Some)
        .map_err(|source: proto::InvalidToken| CertsError::File { path, source: io::Error::other(source) })
}

/// Whom a certificate is for.
#[derive(Clone, Debug)]
pub enum Subject {
    /// The coordinator, under these names and addresses.
    Coordinator(Vec<String>),
    /// A worker.
    Worker(String),
}

/// A certificate with all above it, and its private key, as PEM.
pub struct Certified {
    /// The certificate, then the CA's.
    pub chain: String,
    /// The private key.
    pub key: String,
}

/// The CA.
pub struct Authority {
    issuer: Issuer<'static, KeyPair>,
    pem: String,
}

impl Authority {
    fn new(valid: &Range<SystemTime>) -> Result<Self, CertsError> {
        let key = KeyPair::generate()?;
        let mut params = Self::params();
        (params.not_before, params.not_after) = (valid.start.into(), valid.end.into());
        let pem = params.self_signed(&key)?.pem();
        Ok(Self { issuer: Issuer::new(params, key), pem })
    }

    /// The CA of a folder of [`make_folder`].
    pub fn read(folder: &Path) -> Result<Self, CertsError> {
        let key = KeyPair::from_pem(&read_small(&folder.join(CA_KEY_FILE))?)?;
        Ok(Self { issuer: Issuer::new(Self::params(), key), pem: read_small(&folder.join(CA_FILE))? })
    }

    /// What all CAs have in common; name and key identifier of the issuer follow from it and the key.
    fn params() -> CertificateParams {
        let mut params = CertificateParams::default();
        params.distinguished_name = rcgen::DistinguishedName::new();
        params.distinguished_name.push(DnType::CommonName, "descry CA");
        params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
        params.key_usages = vec![KeyUsagePurpose::KeyCertSign];
        params
    }

    /// Makes a key and a certificate for it.
    pub fn certify(&self, subject: &Subject, valid: &Range<SystemTime>) -> Result<Certified, CertsError> {
        let (names, common_name, usage) = match subject {
            Subject::Coordinator(hosts) => {
                (hosts.clone(), "descry coordinator", ExtendedKeyUsagePurpose::ServerAuth)
            }
            Subject::Worker(name) => (Vec::new(), name.as_str(), ExtendedKeyUsagePurpose::ClientAuth),
        };
        let mut params = CertificateParams::new(names)?;
        (params.not_before, params.not_after) = (valid.start.into(), valid.end.into());
        params.distinguished_name = rcgen::DistinguishedName::new();
        params.distinguished_name.push(DnType::CommonName, common_name);
        params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
        params.extended_key_usages = vec![usage];
        params.use_authority_key_identifier_extension = true;
        let key = KeyPair::generate()?;
        let certificate = params.signed_by(&key, &self.issuer)?;
        Ok(Certified { chain: certificate.pem() + &self.pem, key: key.serialize_pem() })
    }
}

fn write_secret(folder: &NewFolder, name: &str, text: &str) -> Result<(), CertsError> {
    let failed = |source| CertsError::File { path: folder.path().join(name), source };
    folder.write(name, text.as_bytes()).map_err(failed)
}

/// A text of at most 64 KiB.
fn read_small(path: &Path) -> Result<String, CertsError> {
    use io::Read as _;
    let failed = |source| CertsError::File { path: path.to_owned(), source };
    if !fs::metadata(path).map_err(failed)?.is_file() {
        // A pipe would be waited for.
        return Err(failed(io::Error::new(io::ErrorKind::InvalidInput, "something that is no file")));
    }
    let mut text = String::new();
    fs::File::open(path).and_then(|file| file.take(1 << 16).read_to_string(&mut text)).map_err(failed)?;
    Ok(text)
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt as _;

    use super::*;

    fn site(host: &str) -> Site {
        Site { hosts: vec![host.to_owned()], port: 7701 }
    }

    #[test]
    fn a_folder_is_made_once_and_secrets_are_their_owners() {
        let parent = tempfile::tempdir().unwrap();
        let folder = parent.path().join("tls");
        make_folder(&folder, &site("gpu-host"), &validity(10)).unwrap();
        assert!(is_made(&folder));
        let address = join_address(&folder).unwrap();
        assert_eq!(address.to_string(), "https://gpu-host:7701");
        assert_eq!(address.trust.unwrap().token, token(&folder).unwrap());
        assert!(matches!(
            make_folder(&folder, &site("gpu-host"), &validity(10)),
            Err(CertsError::Foreign(_))
        ));

        let worker = add_worker(&folder, "lab-1", &validity(10)).unwrap();
        assert_eq!(join_address(&worker).unwrap().trust.unwrap().token, None);
        assert!(matches!(add_worker(&folder, "lab-1", &validity(10)), Err(CertsError::Exists(_))));
        for secret in [CA_KEY_FILE, KEY_FILE, TOKEN_FILE, JOIN_FILE, "workers/lab-1/key.pem"] {
            let mode = fs::metadata(folder.join(secret)).unwrap().permissions().mode();
            assert_eq!(mode & 0o777, 0o600, "{secret}");
        }
        fs::remove_file(folder.join(TOKEN_FILE)).unwrap();
        assert_eq!(token(&folder).unwrap(), None);
    }

    #[test]
    fn names_stay_in_their_folder() {
        for name in ["", "..", "../x", "a/b", ".hidden", "a b", &"x".repeat(65)] {
            assert!(!is_worker_name(name), "{name}");
        }
        assert!(is_worker_name("lab-pc_3.example"));
    }
}
