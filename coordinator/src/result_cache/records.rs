//! Remembered counts as bytes, and back: the sources, then records in the order of their descriptors, each the length of
//! the descriptor's canonical bytes, these bytes, the queries whose object and whose category was recognised, and the
//! number of its source.

use std::collections::BTreeMap;
use std::sync::Arc;

use descriptor::Descriptor;
use results::Counts;

use super::source::{self, Source, Wrong};
use super::{CachedCounts, CountsByDescriptor};

/// First bytes of a payload; the number grows with every change of its form.
const MAGIC: &[u8; 8] = b"counts 3";
/// Descriptors remembered for one matching: a whole entry is read when a run starts, and this many of the paper's are
/// 35 MB.
const MAX_RECORDS: usize = 1 << 20;

/// Whether a payload has a form that earlier releases wrote: who computed its counts is not known.
pub(super) fn is_older(payload: &[u8]) -> bool {
    [b"counts 1", b"counts 2"].iter().any(|magic| payload.starts_with(*magic))
}

/// Leaves at most [`MAX_RECORDS`], those with most objects recognised: searches come back to good descriptors. What
/// is left does not depend on the order in which runs ended.
pub(super) fn truncate(known: &mut CountsByDescriptor) {
    keep_best(known, MAX_RECORDS);
}

fn keep_best(known: &mut CountsByDescriptor, most: usize) {
    if known.len() <= most {
        return;
    }
    let mut order: Vec<(Descriptor, CachedCounts)> = std::mem::take(known).into_iter().collect();
    // Stable: among equals the first descriptors stay.
    order.sort_by_key(|(_, remembered)| std::cmp::Reverse(remembered.counts.object_correct));
    order.truncate(most);
    known.extend(order);
}

/// A payload for the store; every record has this number of queries. A descriptor of more than 255 bytes is left out.
pub(super) fn encode(known: &CountsByDescriptor, queries: u32) -> Vec<u8> {
    let mut sources: BTreeMap<&Source, u32> =
        known.values().map(|remembered| (&*remembered.source, 0)).collect();
    (0..).zip(sources.values_mut()).for_each(|(number, place)| *place = number);
    let mut payload = MAGIC.to_vec();
    payload.extend_from_slice(&queries.to_le_bytes());
    payload.extend_from_slice(&(sources.len() as u32).to_le_bytes());
    sources.keys().for_each(|one| source::append(one, &mut payload));
    for (descriptor, CachedCounts { counts, source }) in known {
        let bytes = descriptor.to_bytes();
        let Ok(length) = u8::try_from(bytes.len()) else { continue };
        payload.push(length);
        payload.extend_from_slice(&bytes);
        let numbers = [counts.object_correct, counts.category_correct, sources[&**source]];
        payload.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
    }
    payload
}

/// The inverse of [`encode`]; says what a payload is that it cannot have written for these queries.
pub(super) fn decode(payload: &[u8], queries: u32) -> Result<CountsByDescriptor, String> {
    let (of, known) = decode_any(payload)?;
    if of != queries {
        return Err(format!("counts of {of} queries instead of {queries}"));
    }
    Ok(known)
}

/// A payload without the records that are in doubt, and how many these are; `None` instead of a payload without records
/// and of one that cannot be read.
pub(super) fn without(payload: &[u8], wrong: &Wrong) -> (Option<Vec<u8>>, usize) {
    let Ok((queries, mut known)) = decode_any(payload) else { return (None, 0) };
    let before = known.len();
    known.retain(|_, remembered| !wrong.concerns(&remembered.source));
    let dropped = before - known.len();
    ((!known.is_empty()).then(|| encode(&known, queries)), dropped)
}

/// What a payload holds, with the number of queries.
fn decode_any(payload: &[u8]) -> Result<(u32, CountsByDescriptor), String> {
    let rest = payload.strip_prefix(MAGIC).ok_or("another form")?;
    let (queries, rest) = split_number(rest).ok_or("no header")?;
    let (count, mut rest) = split_number(rest).ok_or("no header")?;
    let mut sources = Vec::new();
    for _ in 0..count {
        let (one, after) = source::split(rest).ok_or("an impossible source")?;
        sources.push(Arc::new(one));
        rest = after;
    }
    if !sources.is_sorted_by(|one, next| one < next) {
        return Err("sources out of order".to_owned());
    }
    let mut known = CountsByDescriptor::new();
    while !rest.is_empty() {
        let (descriptor, remembered, after) =
            decode_record(rest, queries, &sources).ok_or("an impossible record")?;
        if known.last_key_value().is_some_and(|(last, _)| *last >= descriptor) {
            return Err("records out of order".to_owned());
        }
        known.insert(descriptor, remembered);
        if known.len() > MAX_RECORDS {
            return Err(format!("more than {MAX_RECORDS} records"));
        }
        rest = after;
    }
    Ok((queries, known))
}

/// The first record, and the bytes after it.
fn decode_record<'a>(
    bytes: &'a [u8],
    queries: u32,
    sources: &[Arc<Source>],
) -> Option<(Descriptor, CachedCounts, &'a [u8])> {
    let (length, rest) = bytes.split_first()?;
    let (descriptor, rest) = rest.split_at_checked(usize::from(*length))?;
    let (object_correct, rest) = split_number(rest)?;
    let (category_correct, rest) = split_number(rest)?;
    let (source, rest) = split_number(rest)?;
    let counts = Counts { object_correct, category_correct, queries };
    let source = Arc::clone(sources.get(source as usize)?);
    // The same object is of the same category.
    let countable = object_correct <= category_correct && category_correct <= queries;
    let remembered = CachedCounts { counts, source };
    countable.then_some((Descriptor::from_bytes(descriptor).ok()?, remembered, rest))
}

/// The first four bytes as a number, and those after them.
fn split_number(bytes: &[u8]) -> Option<(u32, &[u8])> {
    let (number, rest) = bytes.split_first_chunk::<4>()?;
    Some((u32::from_le_bytes(*number), rest))
}

#[cfg(test)]
mod tests {
    use descriptor::{Family, Parameters, SearchSpace};
    use proptest::prelude::*;

    use super::super::source::tests::{principal, source};
    use super::*;
    use cluster::scheduler::Basis;
    use proto::Principal;

    const QUERIES: u32 = 352;
    /// Length, tag and version before the genes of the paper's family; its genes, two counts and the source.
    const RECORD_BYTES: usize = 3 + 5 * 4 + 3 * 4;

    fn header_bytes() -> usize {
        let mut header = MAGIC.to_vec();
        source::append(&own(), &mut header);
        header.len() + 2 * 4
    }

    fn own() -> Source {
        source(1, &[Principal::Coordinator], Basis::Own)
    }

    fn remembered(counts: Counts) -> CachedCounts {
        CachedCounts { counts, source: Arc::new(own()) }
    }

    /// A descriptor of any family, and counts.
    fn record() -> impl Strategy<Value = (Descriptor, CachedCounts)> {
        let counts = (0..=QUERIES).prop_flat_map(|category| (0..=category, Just(category)));
        let colour = any::<bool>();
        let family = prop::sample::select(Family::ALL.to_vec());
        let basis = prop::sample::select(vec![Basis::Earned, Basis::Audited, Basis::Own]);
        let one =
            (0_u8..3, 1_u8..3, basis).prop_map(|(run, byte, basis)| source(run, &[principal(byte)], basis));
        (family, colour, any::<[u16; 5]>(), counts, one).prop_map(|(family, colour, choices, counts, one)| {
            let domains: Vec<_> = family.genes().iter().map(|spec| spec.default_domain()).collect();
            let colour = colour || family != Family::DiskRing;
            let space = SearchSpace::new(family, colour, &domains);
            let descriptor = match space {
                Ok(space) => {
                    let genes = space.genes();
                    let choose = |((_, domain), choice): (&(_, descriptor::Domain), u16)| {
                        u32::from(choice) % domain.count
                    };
                    space.decode(&genes.iter().zip(choices).map(choose).collect::<Vec<_>>()).unwrap()
                }
                Err(_) => Descriptor::default_of(family),
            };
            let (object_correct, category_correct) = counts;
            let counts = Counts { object_correct, category_correct, queries: QUERIES };
            (descriptor, CachedCounts { counts, source: Arc::new(one) })
        })
    }

    fn some() -> CountsByDescriptor {
        [(8, 3), (9, 7), (10, 5), (11, 7)]
            .map(|(shape_bins, object_correct)| {
                let counts = Counts { object_correct, category_correct: 20, queries: QUERIES };
                let parameters = Parameters { shape_bins, ..Parameters::PAPER_BEST };
                (Descriptor::DiskRing(parameters), remembered(counts))
            })
            .into()
    }

    proptest! {
        #[test]
        fn counts_are_read_as_they_were_written(known in prop::collection::vec(record(), 0..9)) {
            let known: CountsByDescriptor = known.into_iter().collect();
            prop_assert_eq!(decode(&encode(&known, QUERIES), QUERIES), Ok(known));
        }

        #[test]
        fn nothing_is_left_of_what_is_in_doubt_and_everything_else(
            known in prop::collection::vec(record(), 0..9),
            byte in 1_u8..4,
            run in 0_u8..4,
        ) {
            let known: CountsByDescriptor = known.into_iter().collect();
            let wrong = Wrong {
                principals: [principal(byte)].into(),
                runs: [proto::SessionId([run; 16])].into(),
            };
            let mut left = known.clone();
            left.retain(|_, one| one.source.run.0 != [run; 16] && !one.source.provenance.principals.contains(&principal(byte)));
            let (payload, dropped) = without(&encode(&known, QUERIES), &wrong);
            prop_assert_eq!(dropped, known.len() - left.len());
            prop_assert_eq!(payload.map(|payload| decode(&payload, QUERIES)), (!left.is_empty()).then_some(Ok(left)));
        }

        #[test]
        fn arbitrary_bytes_are_refused_or_make_sense(
            tail in prop::collection::vec(any::<u8>(), 0..200),
            has_header in any::<bool>(),
        ) {
            let mut payload = if has_header { encode(&some(), QUERIES) } else { Vec::new() };
            payload.extend(tail);
            if let Ok(known) = decode(&payload, QUERIES) {
                prop_assert_eq!(encode(&known, QUERIES), payload);
            }
        }
    }

    #[test]
    fn impossible_payloads_are_refused() {
        let sound = encode(&some(), QUERIES);
        assert_eq!(sound.len(), header_bytes() + 4 * RECORD_BYTES);
        assert!(decode(&sound, QUERIES).is_ok());
        assert!(decode(&sound, QUERIES + 1).is_err());
        assert!(decode(&sound[..sound.len() - 1], QUERIES).is_err());
        let spoilt = |record: usize, field: usize, number: u32| {
            let mut payload = sound.clone();
            let at = header_bytes() + record * RECORD_BYTES + 3 + 4 * field;
            payload[at..at + 4].copy_from_slice(&number.to_le_bytes());
            decode(&payload, QUERIES)
        };
        assert!(spoilt(1, 0, 9).is_ok());
        assert!(spoilt(1, 0, 8).is_err(), "the same descriptor twice");
        assert!(spoilt(1, 0, 12).is_err(), "order");
        assert!(spoilt(0, 0, 1).is_err(), "a gene outside its limits");
        assert!(spoilt(0, 5, 21).is_err(), "more objects than categories");
        assert!(spoilt(0, 6, QUERIES + 1).is_err(), "more categories than queries");
        assert!(spoilt(0, 7, 1).is_err(), "a source that is not there");
        for magic in [b"counts 1", b"counts 2"] {
            let older = [magic, &sound[MAGIC.len()..]].concat();
            assert!(is_older(&older) && !is_older(&sound) && decode(&older, QUERIES).is_err());
        }
    }

    #[test]
    fn what_is_too_much_loses_the_worst() {
        let mut known = some();
        let objects = |known: &CountsByDescriptor| {
            known.values().map(|one| one.counts.object_correct).collect::<Vec<_>>()
        };
        keep_best(&mut known, 3);
        assert_eq!(objects(&known), [7, 5, 7]);
        keep_best(&mut known, 1);
        assert_eq!(known, some().into_iter().skip(1).take(1).collect());
    }
}
