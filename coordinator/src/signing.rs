//! Signatures of what is kept: ed25519 over the files of a folder that all its others follow from.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Read as _, Write as _};
use std::os::unix::fs::{OpenOptionsExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};

use proto::{hex, parse_hex};
use ring::signature::{ED25519, Ed25519KeyPair, KeyPair as _, UnparsedPublicKey};

/// File in a folder that was signed: the signer's public key and the signature.
pub const SIGNATURE_FILE: &str = "signature";
/// First word of a signing key's file.
const SECRET: &str = "descry-signing-key";
/// First word of a public key's file.
const PUBLIC: &str = "descry-public-key";
/// First word of a signature.
const SIGNATURE: &str = "descry-signature";
/// No such file is longer, bytes.
const MAX_BYTES: u64 = 1024;

/// Why nothing was signed.
#[derive(Debug, thiserror::Error)]
pub enum SigningError {
    /// A file.
    #[error("{path}: cannot be used, got {source}\ncheck the path, permissions and free space")]
    File {
        /// Which one.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// What is there is kept.
    #[error("{0}: is there already\nchoose another name: what it has signed could not be signed again")]
    Exists(PathBuf),
    /// Others could sign with it.
    #[error(
        "{path}: must be readable by its owner only, got mode {mode:o}\nrun chmod 600 {path}, and make another key if somebody may have read it"
    )]
    Readable {
        /// The key.
        path: PathBuf,
        /// Its permissions.
        mode: u32,
    },
    /// Something else.
    #[error("{0}: is no signing key\nmake one with `coordinator keygen`")]
    NoKey(PathBuf),
    /// Neither a public key nor a file with one.
    #[error(
        "--key: must be a public key or its file, got {0}\n`coordinator keygen` prints it, and writes it to KEY.pub"
    )]
    NoPublicKey(String),
}

/// Signs. It has no textual form.
pub struct SigningKey(Ed25519KeyPair);

/// Verifies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PublicKey([u8; 32]);

impl std::fmt::Display for PublicKey {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&hex(&self.0))
    }
}

impl SigningKey {
    /// Makes a key and writes it to `path`, for its owner only, and its public key beside it.
    pub fn make(path: &Path) -> Result<PublicKey, SigningError> {
        let failed = |source| SigningError::File { path: path.to_owned(), source };
        let seed: [u8; 32] = rand::random();
        let file = OpenOptions::new().write(true).create_new(true).mode(0o600).open(path);
        let mut file = file.map_err(|error| match error.kind() {
            io::ErrorKind::AlreadyExists => SigningError::Exists(path.to_owned()),
            _ => failed(error),
        })?;
        let written = writeln!(file, "{SECRET} {}", hex(&seed)).and_then(|()| file.sync_all());
        written.map_err(failed)?;
        let public = Self::of(&seed, path)?.public();
        let beside = public_file(path);
        atomic::write(&beside, format!("{PUBLIC} {public}\n").as_bytes())
            .map_err(|source| SigningError::File { path: beside, source })?;
        Ok(public)
    }

    /// The key in a file of [`SigningKey::make`].
    pub fn read(path: &Path) -> Result<Self, SigningError> {
        let failed = |source| SigningError::File { path: path.to_owned(), source };
        let mode = fs::metadata(path).map_err(failed)?.permissions().mode() & 0o777;
        if mode & 0o077 != 0 {
            return Err(SigningError::Readable { path: path.to_owned(), mode });
        }
        let text = read_small(path).map_err(failed)?;
        let seed = text.strip_prefix(SECRET).and_then(|seed| parse_hex(seed.trim()));
        Self::of(&seed.ok_or_else(|| SigningError::NoKey(path.to_owned()))?, path)
    }

    fn of(seed: &[u8; 32], path: &Path) -> Result<Self, SigningError> {
        let pair = Ed25519KeyPair::from_seed_unchecked(seed);
        pair.map(Self).map_err(|_| SigningError::NoKey(path.to_owned()))
    }

    /// Its public key.
    pub fn public(&self) -> PublicKey {
        let mut bytes = [0; 32];
        bytes.copy_from_slice(self.0.public_key().as_ref());
        PublicKey(bytes)
    }

    /// Signs these files of a folder.
    pub fn sign(&self, folder: &Path, files: &[&str]) -> Result<(), SigningError> {
        let message = message(folder, files).map_err(|(path, source)| SigningError::File { path, source })?;
        let signature = self.0.sign(message.as_bytes());
        let text = format!("{SIGNATURE} {} {}\n", self.public(), hex(signature.as_ref()));
        let path = folder.join(SIGNATURE_FILE);
        atomic::write(&path, text.as_bytes()).map_err(|source| SigningError::File { path, source })
    }
}

impl PublicKey {
    /// A key as it is printed, or the file with one.
    pub fn read(text: &str) -> Result<Self, SigningError> {
        let no_key = || SigningError::NoPublicKey(text.escape_debug().take(80).collect());
        if let Some(bytes) = parse_hex(text) {
            return Ok(Self(bytes));
        }
        let file = read_small(Path::new(text)).map_err(|_| no_key())?;
        file.strip_prefix(PUBLIC).and_then(|key| parse_hex(key.trim())).map(Self).ok_or_else(no_key)
    }

    /// Refuses files of a folder that are not as the owner of this key has signed them; `Err` says why.
    pub fn verify(&self, folder: &Path, files: &[&str]) -> Result<(), String> {
        let path = folder.join(SIGNATURE_FILE);
        let at = path.display();
        let text = read_small(&path).map_err(|error| format!("{at}: cannot be read, got {error}"))?;
        let mut words = text.split_whitespace();
        let parts = (words.next(), words.next().and_then(parse_hex), words.next().and_then(parse_hex::<64>));
        let (Some(SIGNATURE), Some(signer), Some(signature), None) =
            (parts.0, parts.1, parts.2, words.next())
        else {
            return Err(format!("{at}: is no signature"));
        };
        if Self(signer) != *self {
            return Err(format!("{at}: must be by {self}, got one by {}", Self(signer)));
        }
        let message = message(folder, files)
            .map_err(|(path, error)| format!("{}: cannot be read, got {error}", path.display()))?;
        let verified = UnparsedPublicKey::new(&ED25519, self.0).verify(message.as_bytes(), &signature);
        verified.map_err(|_| format!("{at}: is not of these files: one of {} was changed", files.join(", ")))
    }
}

/// The file of a public key beside that of its signing key.
pub fn public_file(key: &Path) -> PathBuf {
    let mut name = key.as_os_str().to_owned();
    name.push(".pub");
    PathBuf::from(name)
}

/// What is signed: names and checksums of files.
fn message(folder: &Path, files: &[&str]) -> Result<String, (PathBuf, io::Error)> {
    let mut message = format!("{SIGNATURE}\n");
    for name in files {
        let path = folder.join(name);
        match fs::read(&path) {
            Ok(bytes) => message += &format!("{}  {name}\n", blake3::hash(&bytes)),
            Err(error) => return Err((path, error)),
        }
    }
    Ok(message)
}

fn read_small(path: &Path) -> io::Result<String> {
    if !fs::metadata(path)?.is_file() {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "something that is no file"));
    }
    let mut text = String::new();
    File::open(path)?.take(MAX_BYTES).read_to_string(&mut text)?;
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Test 1 of RFC 8032, section 7.1.
    #[test]
    fn keys_and_signatures_are_those_of_the_standard() {
        let seed = parse_hex("9d61b19deffd5a60ba844af492ec2cc44449c5697b326919703bac031cae7f60").unwrap();
        let key = SigningKey::of(&seed, Path::new("key")).unwrap();
        let public = "d75a980182b10ab7d54bfed3c964073a0ee172f3daa62325af021a68f707511a";
        assert_eq!(key.public().to_string(), public);
        let signature = "e5564300c360ac729086e2cc806e828a84877f1eb8e5d974d873e065224901555fb8821590a33bacc61e39701cf9b46bd25bf5f0595bbe24655141438e7a100b";
        assert_eq!(hex(key.0.sign(b"").as_ref()), signature);
    }

    #[test]
    fn a_signature_is_of_one_key_and_of_these_files_as_they_are() {
        let folder = tempfile::tempdir().unwrap();
        let (path, other) = (folder.path().join("key"), folder.path().join("other"));
        let public = SigningKey::make(&path).unwrap();
        let stranger = SigningKey::make(&other).unwrap();
        let files = ["a", "b"];
        for name in files {
            fs::write(folder.path().join(name), name).unwrap();
        }
        let verify = |key: &PublicKey| key.verify(folder.path(), &files);
        assert!(verify(&public).unwrap_err().contains("cannot be read"));
        SigningKey::read(&path).unwrap().sign(folder.path(), &files).unwrap();
        assert_eq!(verify(&public), Ok(()));
        assert!(verify(&stranger).unwrap_err().contains("must be by"));
        assert!(public.verify(folder.path(), &["b", "a"]).is_err(), "other files");

        let signature = folder.path().join(SIGNATURE_FILE);
        let text = fs::read_to_string(&signature).unwrap();
        for (place, byte) in text.char_indices().filter(|(_, byte)| !byte.is_whitespace()) {
            let mut changed = text.clone().into_bytes();
            changed[place] = if byte == '0' { b'1' } else { b'0' };
            fs::write(&signature, changed).unwrap();
            assert!(verify(&public).is_err(), "{place}");
        }
        for cut in 0..text.trim_end().len() {
            fs::write(&signature, &text[..cut]).unwrap();
            assert!(verify(&public).is_err(), "{cut}");
        }
        fs::write(&signature, &text).unwrap();
        assert_eq!(verify(&public), Ok(()));
        fs::write(folder.path().join("b"), "a").unwrap();
        assert!(verify(&public).unwrap_err().contains("one of a, b was changed"));
        fs::remove_file(folder.path().join("b")).unwrap();
        assert!(verify(&public).unwrap_err().contains("cannot be read"));
    }

    #[test]
    fn a_key_is_its_owners_and_made_once() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("key");
        let public = SigningKey::make(&path).unwrap();
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o777;
        assert_eq!(mode(&path), 0o600);
        assert!(matches!(SigningKey::make(&path), Err(SigningError::Exists(_))));
        let beside = public_file(&path);
        let printed = public.to_string();
        for text in [printed.as_str(), beside.to_str().unwrap()] {
            assert!(PublicKey::read(text).is_ok_and(|read| read == public), "{text}");
        }
        for text in ["", "ab", path.to_str().unwrap(), folder.path().to_str().unwrap()] {
            assert!(matches!(PublicKey::read(text), Err(SigningError::NoPublicKey(_))), "{text}");
        }
        assert!(matches!(SigningKey::read(&beside), Err(SigningError::Readable { .. })));
        fs::set_permissions(&beside, fs::Permissions::from_mode(0o600)).unwrap();
        assert!(matches!(SigningKey::read(&beside), Err(SigningError::NoKey(_))));
        let message = SigningKey::read(&beside).err().unwrap().to_string();
        assert!(!message.contains(&printed));
        fs::set_permissions(&path, fs::Permissions::from_mode(0o640)).unwrap();
        assert!(matches!(SigningKey::read(&path), Err(SigningError::Readable { mode: 0o640, .. })));
    }
}
