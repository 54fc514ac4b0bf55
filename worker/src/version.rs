//! What `--version` says: release, commit and the version of what is computed.

/// Digits that name a commit.
const DIGITS: usize = 9;
/// Of a build outside a repository of git that does not get `DESCRY_COMMIT`.
pub const NO_COMMIT: &str = "unknown";

/// The commit that a program is built from, for the program alone: a library that knew it would be compiled again for each
/// commit, with all that depends on it.
///
/// Whoever builds without git, from an archive for example, sets `DESCRY_COMMIT`.
#[macro_export]
macro_rules! commit {
    () => {{
        static LAST: $crate::version::Commit =
            $crate::version::Commit::last(include_bytes!(env!("DESCRY_HEAD_LOG")));
        const GIVEN: &str = match option_env!("DESCRY_COMMIT") {
            Some(commit) => commit,
            None => "",
        };
        if GIVEN.is_empty() { LAST.as_str() } else { GIVEN }
    }};
}

/// The commit that is checked out, copied out of the log that git keeps of it, so that no program contains that log.
#[derive(Clone, Copy, Debug)]
pub struct Commit(Option<[u8; DIGITS]>);

impl Commit {
    /// What the last line of git's log of HEAD leads to: `<before> <after> <who> <when>`, tab, what was done.
    pub const fn last(log: &[u8]) -> Self {
        let mut start = log.len().saturating_sub(1); // its last byte ends a line
        while start > 0 && log[start - 1] != b'\n' {
            start -= 1;
        }
        while start < log.len() && log[start] != b' ' {
            start += 1;
        }
        start += 1;
        if start + DIGITS > log.len() {
            return Self(None);
        }
        let mut digits = [0; DIGITS];
        let mut at = 0;
        while at < DIGITS {
            digits[at] = log[start + at];
            if !digits[at].is_ascii_hexdigit() {
                return Self(None);
            }
            at += 1;
        }
        Self(Some(digits))
    }

    /// Its first digits, or [`NO_COMMIT`].
    pub fn as_str(&'static self) -> &'static str {
        let digits = self.0.as_ref().and_then(|digits| std::str::from_utf8(digits).ok());
        digits.unwrap_or(NO_COMMIT)
    }
}

/// What follows the name of a program.
pub(crate) fn version(commit: &str) -> String {
    format!(
        "{} (commit {commit}, evaluation version {})",
        env!("CARGO_PKG_VERSION"),
        descriptor::EVALUATION_VERSION
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_commit_is_where_the_last_line_leads() {
        const LINE: &str = "0000000000000000000000000000000000000000 365ef84d1029bf4b35e4c793a82d8a079cc00001 A <a@b.c> 1 +0000\tcommit: x 1234567890\n";
        const NEXT: &str = "365ef84d1029bf4b35e4c793a82d8a079cc00001 8a079ccf209811a29317015b19da7cba23dc831c A <a@b.c> 2 +0000\tcommit: y\n";
        let named = |log: &str| {
            let commit: &'static Commit = Box::leak(Box::new(Commit::last(log.as_bytes())));
            commit.as_str()
        };
        assert_eq!(named(LINE), "365ef84d1");
        assert_eq!(named(&format!("{LINE}{NEXT}")), "8a079ccf2");
        assert_eq!(named(NEXT.trim_end()), "8a079ccf2");
        for damaged in [
            "",
            "\n",
            " ",
            "\n\n",
            "0000",
            "0000 365ef84d",
            "0000 365ef84dx00",
            "365ef84d1029bf",
            "ä ä\u{fffd} ä",
        ] {
            assert_eq!(named(damaged), NO_COMMIT, "{damaged:?}");
        }
    }
}
