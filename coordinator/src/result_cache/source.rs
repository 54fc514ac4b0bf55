//! Where something comes from that is kept for later runs, and its form in the store.

use std::collections::BTreeSet;
use std::fmt;

use cluster::scheduler::{Basis, Provenance};
use proto::{Principal, SessionId};
use serde::{Deserialize, Serialize};

/// Longest form of a source that is read, bytes: a thousand principals.
const MAX_BYTES: usize = 100_000;

/// The run that has kept something, and on whose word.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Source {
    /// The session of that run, or of the command that it was computed for.
    pub run: SessionId,
    /// Who computed it, and why others may go on with it.
    pub provenance: Provenance,
}

impl Source {
    /// Who was wrong, if what comes from here is: the coordinator's own process only where nobody else was asked.
    pub fn suspects(&self) -> BTreeSet<Principal> {
        let mut suspects = self.provenance.principals.clone();
        if suspects.len() > 1 {
            suspects.remove(&Principal::Coordinator);
        }
        suspects
    }
}

/// Principals and runs that were found to be wrong.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Wrong {
    /// Whatever rests on the word of one of these is in doubt.
    pub principals: BTreeSet<Principal>,
    /// So is whatever one of these has kept.
    pub runs: BTreeSet<SessionId>,
}

impl Wrong {
    /// These principals.
    pub fn principals(principals: BTreeSet<Principal>) -> Self {
        Self { principals, runs: BTreeSet::new() }
    }

    /// Whether nobody was.
    pub fn is_empty(&self) -> bool {
        self.principals.is_empty() && self.runs.is_empty()
    }

    /// Whether what has this source is in doubt.
    pub fn concerns(&self, source: &Source) -> bool {
        self.runs.contains(&source.run) || !self.principals.is_disjoint(&source.provenance.principals)
    }
}

impl fmt::Display for Wrong {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let principals = self.principals.iter().map(ToString::to_string);
        let runs = self.runs.iter().map(|run| format!("session {run}"));
        let names: Vec<String> = principals.chain(runs).collect();
        f.write_str(&names.join(" or "))
    }
}

/// A source as it is kept.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SourceEntry {
    /// Hexadecimal.
    run: String,
    /// As in the table `workers`.
    principals: Vec<String>,
    basis: String,
}

impl From<&Source> for SourceEntry {
    fn from(Source { run, provenance: Provenance { principals, basis } }: &Source) -> Self {
        let principals = principals.iter().map(ToString::to_string).collect();
        Self { run: run.to_string(), principals, basis: basis_name(*basis).to_owned() }
    }
}

impl SourceEntry {
    /// `None` if it names no source.
    pub fn source(&self) -> Option<Source> {
        let principals: BTreeSet<Principal> =
            self.principals.iter().map(|one| one.parse()).collect::<Result<_, _>>().ok()?;
        let basis = basis_of(&self.basis).filter(|_| !principals.is_empty())?;
        Some(Source { run: SessionId::from_hex(&self.run)?, provenance: Provenance { principals, basis } })
    }
}

/// How tables name several principals.
pub fn principals_text(principals: &BTreeSet<Principal>) -> String {
    let names: Vec<String> = principals.iter().map(ToString::to_string).collect();
    names.join(", ")
}

/// The source that a table names; `None` if it names none.
pub fn source_of(run: Option<&str>, principals: Option<&str>, basis: Option<&str>) -> Option<Source> {
    let principals = principals?.split(", ").map(str::to_owned).collect();
    SourceEntry { run: run?.to_owned(), principals, basis: basis?.to_owned() }.source()
}

/// How tables and entries name a basis.
pub fn basis_name(basis: Basis) -> &'static str {
    match basis {
        Basis::Earned => "earned",
        Basis::Audited => "audited",
        Basis::Own => "own",
    }
}

/// The inverse of [`basis_name`].
pub fn basis_of(name: &str) -> Option<Basis> {
    [Basis::Earned, Basis::Audited, Basis::Own].into_iter().find(|basis| basis_name(*basis) == name)
}

/// Appends a source to a payload: its length in four bytes, little-endian, and its JSON.
pub fn append(source: &Source, payload: &mut Vec<u8>) {
    let json = serde_json::to_vec(&SourceEntry::from(source)).expect("texts can be written as JSON");
    payload.extend_from_slice(&(json.len() as u32).to_le_bytes());
    payload.extend_from_slice(&json);
}

/// The source at the beginning of a payload, and the bytes after it.
pub fn split(payload: &[u8]) -> Option<(Source, &[u8])> {
    let (length, rest) = payload.split_first_chunk::<4>()?;
    let length = u32::from_le_bytes(*length) as usize;
    let (json, rest) = rest.split_at_checked(length).filter(|_| length <= MAX_BYTES)?;
    let entry: SourceEntry = serde_json::from_slice(json).ok()?;
    Some((entry.source()?, rest))
}

#[cfg(test)]
pub mod tests {
    use super::*;
    use proto::Origin;

    /// A principal at an address that ends like this.
    pub fn principal(byte: u8) -> Principal {
        Principal::Anonymous(Origin::of([192, 0, 2, byte].into()))
    }

    /// What these principals have given to a run.
    pub fn source(run: u8, principals: &[Principal], basis: Basis) -> Source {
        let principals = principals.iter().copied().collect();
        Source { run: SessionId([run; 16]), provenance: Provenance { principals, basis } }
    }

    #[test]
    fn a_source_is_read_as_it_was_written_and_no_other_text_is_one() {
        for basis in [Basis::Earned, Basis::Audited, Basis::Own] {
            let written = source(1, &[principal(1), Principal::Coordinator], basis);
            let mut payload = Vec::new();
            append(&written, &mut payload);
            payload.extend_from_slice(b"rest");
            assert_eq!(split(&payload), Some((written, &b"rest"[..])));
            assert_eq!(split(&payload[..payload.len() - 5]), None);
        }
        let json = |run: &str, principals: &str, basis: &str| {
            let json = format!(r#"{{"run":"{run}","principals":[{principals}],"basis":"{basis}"}}"#);
            [&(json.len() as u32).to_le_bytes()[..], json.as_bytes()].concat()
        };
        let run = "01".repeat(16);
        assert!(split(&json(&run, "\"coordinator\"", "own")).is_some());
        for bad in [
            json("01", "\"coordinator\"", "own"),
            json(&run, "", "own"),
            json(&run, "\"nobody\"", "own"),
            json(&run, "\"coordinator\"", "hearsay"),
            vec![255; 4],
            Vec::new(),
        ] {
            assert_eq!(split(&bad), None, "{}", String::from_utf8_lossy(&bad));
        }
    }

    #[test]
    fn what_rests_on_a_principal_or_a_run_that_was_wrong_is_in_doubt() {
        let source = source(1, &[principal(1), principal(2)], Basis::Audited);
        let wrong = |principals: &[Principal], runs: &[u8]| Wrong {
            principals: principals.iter().copied().collect(),
            runs: runs.iter().map(|&run| SessionId([run; 16])).collect(),
        };
        assert!(wrong(&[principal(2)], &[]).concerns(&source));
        assert!(wrong(&[principal(3)], &[1]).concerns(&source));
        assert!(!wrong(&[principal(3)], &[2]).concerns(&source));
        assert!(wrong(&[], &[]).is_empty() && !wrong(&[], &[2]).is_empty());
    }

    #[test]
    fn the_own_process_is_blamed_only_where_nobody_else_was_asked() {
        let suspects = |principals: &[Principal]| source(1, principals, Basis::Earned).suspects();
        assert_eq!(suspects(&[Principal::Coordinator]), [Principal::Coordinator].into());
        assert_eq!(suspects(&[Principal::Coordinator, principal(1)]), [principal(1)].into());
        assert_eq!(suspects(&[principal(1), principal(2)]), [principal(1), principal(2)].into());
    }
}
