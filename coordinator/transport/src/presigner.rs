//! Signs URLs to the bucket that the machines of a run share, and counts them.

use std::collections::BTreeMap;
use std::pin::Pin;
use std::sync::{Arc, Mutex, PoisonError};

use proto::{Digest, Principal};

/// The name of kinds that are not counted by a name of their own: workers may ask for any.
const OTHER: &str = "other";

/// An object of the bucket for which a URL is asked.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ObjectRequest {
    /// Which one.
    pub key: Digest,
    /// SHA-256 of the bytes that are to be stored; `None`: it is to be read.
    pub sha256: Option<[u8; 32]>,
}

/// A URL that is good for one object and one method.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SignedUrl {
    /// The URL.
    pub url: String,
    /// SHA-256 of the bytes that may be used of what is read; `None`: whatever is there.
    pub sha256: Option<[u8; 32]>,
}

/// URLs of objects of one kind, or of blobs where it is empty, one for each, in their order; `None` where there is none for
/// a worker. Or why nothing can be signed now.
pub type Presigned = Pin<Box<dyn Future<Output = Result<Vec<Option<SignedUrl>>, String>> + Send>>;
/// Signs them for a principal.
pub type Presign = Arc<dyn Fn(Principal, String, Vec<ObjectRequest>) -> Presigned + Send + Sync>;

/// What a URL was asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Direction {
    /// To read an object.
    Read,
    /// To store one.
    Write,
}

impl Direction {
    /// Its name.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Read => "read",
            Self::Write => "write",
        }
    }
}

/// What became of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum SigningOutcome {
    /// The worker has a URL.
    Signed,
    /// There is none for it.
    Withheld,
    /// It could not be signed.
    Failed,
}

impl SigningOutcome {
    /// Its name.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Signed => "signed",
            Self::Withheld => "withheld",
            Self::Failed => "failed",
        }
    }
}

/// URLs that were asked for, by the name of their object's kind; with every combination that there can be.
pub type UrlCounts = BTreeMap<(&'static str, Direction, SigningOutcome), u64>;

/// Signs URLs, and counts them.
pub struct Presigner {
    sign: Presign,
    /// Kinds and the names by which they are counted.
    kinds: &'static [(&'static str, &'static str)],
    counts: Mutex<UrlCounts>,
}

impl Presigner {
    /// Signs by `sign`; of objects of `kinds`, each with its name, URLs are counted by kind.
    pub fn new(sign: Presign, kinds: &'static [(&'static str, &'static str)]) -> Self {
        let mut counts = UrlCounts::new();
        for kind in kinds.iter().map(|(_, name)| *name).chain([OTHER]) {
            for direction in [Direction::Read, Direction::Write] {
                for outcome in [SigningOutcome::Signed, SigningOutcome::Withheld, SigningOutcome::Failed] {
                    counts.insert((kind, direction, outcome), 0);
                }
            }
        }
        Self { sign, kinds, counts: Mutex::new(counts) }
    }

    /// What was asked for since this start of the coordinator.
    pub fn counts(&self) -> UrlCounts {
        self.counts.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// URLs to objects of a kind for a principal, in their order.
    ///
    /// # Errors
    /// Why none can be signed now.
    pub(crate) async fn urls(
        &self,
        principal: Principal,
        kind: String,
        objects: Vec<ObjectRequest>,
    ) -> Result<Vec<Option<SignedUrl>>, String> {
        let asked = Asked::of(&kind, &objects, self.kinds);
        let urls = (self.sign)(principal, kind, objects).await;
        let outcome = |at: usize| match &urls {
            Ok(urls) if urls.get(at).is_some_and(Option::is_some) => SigningOutcome::Signed,
            Ok(_) => SigningOutcome::Withheld,
            Err(_) => SigningOutcome::Failed,
        };
        self.count(&asked, outcome);
        urls
    }

    /// Counts URLs that whoever asks does not get, whatever they are for.
    pub(crate) fn withhold(&self, kind: &str, objects: &[ObjectRequest]) {
        self.count(&Asked::of(kind, objects, self.kinds), |_| SigningOutcome::Withheld);
    }

    fn count(&self, asked: &Asked, outcome: impl Fn(usize) -> SigningOutcome) {
        let mut counts = self.counts.lock().unwrap_or_else(PoisonError::into_inner);
        for (at, direction) in asked.directions.iter().enumerate() {
            *counts.entry((asked.kind, *direction, outcome(at))).or_default() += 1;
        }
    }
}

/// What URLs are asked for, as it is counted.
struct Asked {
    kind: &'static str,
    directions: Vec<Direction>,
}

impl Asked {
    fn of(kind: &str, objects: &[ObjectRequest], kinds: &[(&str, &'static str)]) -> Self {
        let name = kinds.iter().find(|(one, _)| *one == kind).map_or(OTHER, |(_, name)| *name);
        let direction = |object: &ObjectRequest| match object.sha256 {
            None => Direction::Read,
            Some(_) => Direction::Write,
        };
        Self { kind: name, directions: objects.iter().map(direction).collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use Direction::{Read, Write};
    use SigningOutcome::{Failed, Signed, Withheld};

    /// Gives URLs for what is to be read, and fails for a kind.
    fn presigner() -> Presigner {
        let sign: Presign = Arc::new(|_, kind: String, objects: Vec<ObjectRequest>| {
            let url = |object: &ObjectRequest| SignedUrl { url: object.key.to_string(), sha256: None };
            let urls = objects.iter().map(|one| one.sha256.is_none().then(|| url(one))).collect();
            Box::pin(async move { if kind == "broken" { Err("no key".to_owned()) } else { Ok(urls) } })
        });
        Presigner::new(sign, &[("cloud 2", "cloud"), ("broken", "broken")])
    }

    fn objects() -> Vec<ObjectRequest> {
        [None, Some([0; 32]), None].map(|sha256| ObjectRequest { key: Digest([1; 32]), sha256 }).into()
    }

    #[tokio::test]
    async fn urls_are_counted_by_what_became_of_them_and_by_kinds_that_are_known() {
        let presigner = presigner();
        let all = presigner.counts();
        assert_eq!((all.len(), all.values().sum::<u64>()), (3 * 2 * 3, 0));
        assert!(presigner.urls(Principal::Coordinator, "cloud 2".to_owned(), objects()).await.is_ok());
        assert!(presigner.urls(Principal::Coordinator, "broken".to_owned(), objects()).await.is_err());
        for kind in ["cloud 1", "made up", ""] {
            assert!(presigner.urls(Principal::Coordinator, kind.to_owned(), objects()).await.is_ok());
        }
        presigner.withhold("cloud 2", &objects());
        let mut counts = presigner.counts();
        assert_eq!(counts.len(), all.len(), "what workers call a kind is no label");
        counts.retain(|_, count| *count > 0);
        let expected = [
            (("broken", Read, Failed), 2),
            (("broken", Write, Failed), 1),
            (("cloud", Read, Signed), 2),
            (("cloud", Read, Withheld), 2),
            (("cloud", Write, Withheld), 2),
            (("other", Read, Signed), 6),
            (("other", Write, Withheld), 3),
        ];
        assert_eq!(counts, expected.into());
    }
}
