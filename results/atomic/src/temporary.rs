//! Names of files and folders that are being made: host and process tell whether their writer is still there.

use std::io;
use std::path::Path;
use std::sync::LazyLock;

const PREFIX: &str = ".tmp-";
/// Random characters at the end of a name.
const RANDOM: usize = 12;

/// Who may read what is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// Whom the process's umask lets.
    Umask,
    /// Nobody but the owner: for secrets.
    Owner,
}

impl Access {
    /// Permissions of a new file or folder that has `mode` at most, before the umask.
    #[cfg(unix)]
    pub(crate) fn mode(self, mode: u32) -> u32 {
        match self {
            Self::Umask => mode,
            Self::Owner => mode & 0o700,
        }
    }
}

/// Makes a temporary file or folder of this process, with `mode` as its permissions, less the umask.
pub(crate) fn named<T>(
    access: Access,
    mode: u32,
    make: impl FnOnce(&tempfile::Builder<'_, '_>) -> io::Result<T>,
) -> io::Result<T> {
    let prefix = format!("{PREFIX}{}-{}-", *HOST, std::process::id());
    let mut builder = tempfile::Builder::new();
    builder.prefix(&prefix).rand_bytes(RANDOM);
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(access.mode(mode)));
    make(&builder)
}

/// Whether a name is that of a file or folder that is being made, or was left half made by a process that was killed.
pub fn is_temporary(name: &str) -> bool {
    writer(name).is_some()
}

/// Whether a temporary name's writer is known to have ended. It is unknown for processes of other machines, and where
/// processes cannot be looked up.
pub fn is_abandoned(name: &str) -> bool {
    let processes = Path::new("/proc");
    writer(name).is_some_and(|(host, process)| {
        host == *HOST && processes.join("self").exists() && !processes.join(process.to_string()).exists()
    })
}

/// Host and process in a temporary name; earlier releases wrote it without the dot.
fn writer(name: &str) -> Option<(&str, u32)> {
    let mut parts = name.strip_prefix(PREFIX).or_else(|| name.strip_prefix(&PREFIX[1..]))?.rsplitn(3, '-');
    let (random, process, host) = (parts.next()?, parts.next()?, parts.next()?);
    let is_ours = random.len() == RANDOM && random.bytes().all(|byte| byte.is_ascii_alphanumeric());
    // `parse` alone would take a plus sign.
    let digits = process.bytes().all(|byte| byte.is_ascii_digit());
    (is_ours && digits).then(|| Some((host, process.parse().ok()?)))?
}

/// This machine's name, as far as a file's name can hold it; containers that share a kernel have names of their own.
static HOST: LazyLock<String> = LazyLock::new(|| {
    let name = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let plain = |c: char| if c.is_ascii_alphanumeric() || matches!(c, '.' | '-') { c } else { '_' };
    name.trim().chars().map(plain).take(64).collect()
});

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A temporary name of this machine and that process.
    pub fn name_of(process: u32) -> String {
        format!("{PREFIX}{}-{process}-{}", *HOST, "x".repeat(RANDOM))
    }

    #[test]
    fn temporary_names_tell_their_writer() {
        let own = name_of(std::process::id());
        assert!(is_temporary(&own) && !is_abandoned(&own));
        // No process has this number: it is above the largest that Linux gives.
        let gone = name_of(4_194_305);
        assert!(is_temporary(&gone) && is_abandoned(&gone));
        let elsewhere = gone.replace(&*HOST, "another-host.example");
        assert!(is_temporary(&elsewhere) && !is_abandoned(&elsewhere));
        assert!(is_temporary(&elsewhere[1..]), "of an earlier release");
        for name in ["tmp", ".tmp-1-2-3", ".tmp-host-1-", "notes.txt", &own[..own.len() - 1]] {
            assert!(!is_temporary(name), "{name}");
        }
        assert!(!is_temporary(&own.replace(&format!("-{}-", std::process::id()), "-word-")));
        assert!(!is_temporary(&own.replace(&format!("-{}-", std::process::id()), "-+1-")));
    }
}
