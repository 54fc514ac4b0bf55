//! What earlier inspections found out about clouds, by the bytes of their files, and its form in the store.

use std::collections::BTreeMap;
use std::path::Path;

use cache::Store;
use descriptor::{Preprocess, Skip};
use proto::Digest;

use crate::storage;

/// Kind of the entry in the store.
const KIND: &str = "inspection";
/// Grows when another cloud is usable than before.
const RULES: &[u8] = b"2";
/// First bytes of the payload; the number grows with every change of its form.
const MAGIC: &[u8; 8] = b"inspect1";
/// File digest, verdict, its number, how the spacing is known, spacing.
const RECORD_BYTES: usize = 32 + 1 + 8 + 1 + 8;
/// Clouds of one entry: it has to be read whole at every start.
const MAX_RECORDS: usize = 1 << 20;

/// Median distance from a point of a cloud to its nearest neighbour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Spacing {
    /// Nobody has looked.
    NotMeasured,
    /// There are no two points apart.
    None,
    /// Metres.
    Metres(f64),
}

/// What inspecting a readable cloud gave. Clouds that cannot be read are inspected each time: what is wrong with them
/// depends on the reader, not on the version of the numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Finding {
    pub usable: Result<(), Skip>,
    pub spacing: Spacing,
}

/// Findings by digest of the file's bytes.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Findings(BTreeMap<[u8; 32], Finding>);

impl Findings {
    /// Those of earlier starts with the clouds of this folder; there may be none.
    pub(super) fn read(store: &Store, root: &Path, preprocess: &Preprocess) -> Self {
        let Some(payload) = store.get_local(KIND, key(root, preprocess)) else { return Self::default() };
        Self::decode(&payload, preprocess.min_points).unwrap_or_else(|what| {
            tracing::warn!("cache: inspection of {} is not used, got {what}", root.display());
            Self::default()
        })
    }

    /// Keeps them for the next start.
    pub(super) fn write(&self, store: &Store, root: &Path, preprocess: &Preprocess) {
        store.put_local(KIND, key(root, preprocess), &self.encode());
    }

    pub(super) fn get(&self, file: &[u8; 32]) -> Option<&Finding> {
        self.0.get(file)
    }

    /// Adds to what is known the findings that are new; returns whether there were any. Where everything together
    /// would be too much, only `found` is left.
    pub(super) fn learn(&mut self, found: impl IntoIterator<Item = ([u8; 32], Finding)>) -> bool {
        let mut found: BTreeMap<_, _> = found.into_iter().collect();
        found.retain(|file, finding| match self.0.get(file) {
            None => true,
            Some(known) => known.spacing == Spacing::NotMeasured && finding.spacing != Spacing::NotMeasured,
        });
        if found.is_empty() {
            return false;
        }
        if self.0.len() + found.len() > MAX_RECORDS {
            self.0.clear();
        }
        self.0.extend(found.into_iter().take(MAX_RECORDS));
        true
    }

    fn encode(&self) -> Vec<u8> {
        let mut payload = MAGIC.to_vec();
        payload.reserve_exact(self.0.len() * RECORD_BYTES);
        for (file, Finding { usable, spacing }) in &self.0 {
            let (verdict, number) = match *usable {
                Ok(()) => (0, 0),
                Err(Skip::TooFewPoints { points, .. }) => (1, points as u64),
                Err(Skip::NoKeypointWithNormal { keypoints }) => (2, keypoints as u64),
            };
            let (known, metres) = match *spacing {
                Spacing::NotMeasured => (0, 0.0),
                Spacing::None => (1, 0.0),
                Spacing::Metres(metres) => (2, metres),
            };
            payload.extend_from_slice(file);
            payload.push(verdict);
            payload.extend_from_slice(&number.to_le_bytes());
            payload.push(known);
            payload.extend_from_slice(&metres.to_bits().to_le_bytes());
        }
        payload
    }

    /// The inverse of `encode`; says what a payload is that it cannot have written.
    fn decode(payload: &[u8], min_points: u32) -> Result<Self, String> {
        let records = payload.strip_prefix(MAGIC).ok_or("another form")?;
        let (records, rest) = records.as_chunks::<RECORD_BYTES>();
        if !rest.is_empty() || records.len() > MAX_RECORDS {
            return Err(format!("{} bytes", payload.len()));
        }
        let mut findings = BTreeMap::new();
        for record in records {
            let (file, finding) = decode_record(record, min_points).ok_or("an impossible record")?;
            if findings.last_key_value().is_some_and(|(last, _)| *last >= file) {
                return Err("records out of order".to_owned());
            }
            findings.insert(file, finding);
        }
        Ok(Self(findings))
    }
}

fn decode_record(record: &[u8; RECORD_BYTES], min_points: u32) -> Option<([u8; 32], Finding)> {
    let (file, record) = record.split_first_chunk::<32>()?;
    let (&verdict, record) = record.split_first()?;
    let (number, record) = record.split_first_chunk::<8>()?;
    let (&known, metres) = record.split_first()?;
    let number = usize::try_from(u64::from_le_bytes(*number)).ok()?;
    let metres = f64::from_bits(u64::from_le_bytes(*metres.first_chunk::<8>()?));
    let usable = match verdict {
        0 if number == 0 => Ok(()),
        1 if number < min_points as usize => Err(Skip::TooFewPoints { least: min_points, points: number }),
        2 => Err(Skip::NoKeypointWithNormal { keypoints: number }),
        _ => return None,
    };
    let spacing = match known {
        0 if metres == 0.0 => Spacing::NotMeasured,
        1 if metres == 0.0 => Spacing::None,
        2 if metres.is_finite() && metres > 0.0 => Spacing::Metres(metres),
        _ => return None,
    };
    Some((*file, Finding { usable, spacing }))
}

/// One entry a folder, whatever lists name its clouds and whichever of them have changed: the digests of the files
/// are in the entry.
fn key(root: &Path, preprocess: &Preprocess) -> Digest {
    storage::key(KIND, preprocess, &[RULES, root.as_os_str().as_encoded_bytes()])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn findings() -> Findings {
        let finding = |usable, spacing| Finding { usable, spacing };
        Findings(BTreeMap::from([
            ([1; 32], finding(Ok(()), Spacing::NotMeasured)),
            ([2; 32], finding(Err(Skip::TooFewPoints { least: 10, points: 9 }), Spacing::None)),
            ([3; 32], finding(Err(Skip::NoKeypointWithNormal { keypoints: 7 }), Spacing::Metres(0.0015))),
        ]))
    }

    #[test]
    fn findings_are_read_as_they_were_written() {
        assert_eq!(Findings::decode(&findings().encode(), 10), Ok(findings()));
        assert_eq!(Findings::decode(&Findings::default().encode(), 10), Ok(Findings::default()));
    }

    #[test]
    fn a_payload_that_was_not_written_like_this_is_refused() {
        let sound = findings().encode();
        for length in 0..sound.len() {
            // Cut between two records it is a sound payload of fewer: the store's checksum has to notice that.
            let whole = length >= MAGIC.len() && (length - MAGIC.len()).is_multiple_of(RECORD_BYTES);
            assert_eq!(Findings::decode(&sound[..length], 10).is_ok(), whole, "{length}");
        }
        let spoilt = |at: usize, byte: u8| {
            let mut payload = sound.clone();
            payload[MAGIC.len() + at] = byte;
            Findings::decode(&payload, 10)
        };
        assert!(spoilt(0, 9).is_err(), "order");
        assert!(spoilt(32, 3).is_err(), "verdict");
        assert!(spoilt(33, 1).is_err(), "number of a usable cloud");
        assert!(spoilt(RECORD_BYTES + 33, 10).is_err(), "points that are enough");
        assert!(spoilt(41, 2).is_err(), "spacing of nothing");
        assert!(spoilt(2 * RECORD_BYTES + 49, 0xff).is_err(), "negative spacing");
        assert!(Findings::decode(&sound, 9).is_err(), "written for a larger least number of points");
    }

    #[test]
    fn only_what_is_new_is_learnt() {
        let mut known = findings();
        assert!(!known.learn(findings().0));
        let seen = Finding { usable: Ok(()), spacing: Spacing::NotMeasured };
        let measured = Finding { spacing: Spacing::Metres(0.002), ..seen };
        assert!(known.learn([([1; 32], measured)]));
        assert!(!known.learn([([1; 32], seen)]));
        assert_eq!(known.get(&[1; 32]), Some(&measured));
        assert!(known.learn([([4; 32], seen)]));
        assert_eq!(known.0.len(), 4);
    }
}
