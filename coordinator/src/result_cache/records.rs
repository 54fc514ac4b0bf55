//! Remembered counts as bytes, and back: records in the order of their descriptors, each the length of the descriptor's
//! canonical bytes, these bytes, and the queries whose object and whose category was recognised.

use descriptor::Descriptor;
use results::Counts;

use super::Remembered;

/// First bytes of a payload; the number grows with every change of its form.
const MAGIC: &[u8; 8] = b"counts 2";
/// Descriptors remembered for one matching: a whole entry is read when a run starts, and this many of the paper's are
/// 31 MB.
const MAX_RECORDS: usize = 1 << 20;

/// Whether a payload has a form that earlier releases wrote.
pub(super) fn is_older(payload: &[u8]) -> bool {
    payload.starts_with(b"counts 1")
}

/// Leaves at most [`MAX_RECORDS`], those with most objects recognised: searches come back to good descriptors. What
/// is left does not depend on the order in which runs ended.
pub(super) fn truncate(known: &mut Remembered) {
    keep_best(known, MAX_RECORDS);
}

fn keep_best(known: &mut Remembered, most: usize) {
    if known.len() <= most {
        return;
    }
    let mut order: Vec<(Descriptor, Counts)> = std::mem::take(known).into_iter().collect();
    // Stable: among equals the first descriptors stay.
    order.sort_by_key(|(_, counts)| std::cmp::Reverse(counts.object_correct));
    order.truncate(most);
    known.extend(order);
}

/// A payload for the store; every record has this number of queries. A descriptor of more than 255 bytes is left out.
pub(super) fn encode(known: &Remembered, queries: u32) -> Vec<u8> {
    let mut payload = MAGIC.to_vec();
    payload.extend_from_slice(&queries.to_le_bytes());
    for (descriptor, counts) in known {
        let bytes = descriptor.to_bytes();
        let Ok(length) = u8::try_from(bytes.len()) else { continue };
        payload.push(length);
        payload.extend_from_slice(&bytes);
        payload.extend([counts.object_correct, counts.category_correct].iter().flat_map(|n| n.to_le_bytes()));
    }
    payload
}

/// The inverse of [`encode`]; says what a payload is that it cannot have written for these queries.
pub(super) fn decode(payload: &[u8], queries: u32) -> Result<Remembered, String> {
    let rest = payload.strip_prefix(MAGIC).ok_or("another form")?;
    let (header, mut rest) = rest.split_first_chunk::<4>().ok_or("no header")?;
    let of = u32::from_le_bytes(*header);
    if of != queries {
        return Err(format!("counts of {of} queries instead of {queries}"));
    }
    let mut known = Remembered::new();
    while !rest.is_empty() {
        let (descriptor, counts, after) = decode_record(rest, queries).ok_or("an impossible record")?;
        if known.last_key_value().is_some_and(|(last, _)| *last >= descriptor) {
            return Err("records out of order".to_owned());
        }
        known.insert(descriptor, counts);
        if known.len() > MAX_RECORDS {
            return Err(format!("more than {MAX_RECORDS} records"));
        }
        rest = after;
    }
    Ok(known)
}

/// The first record, and the bytes after it.
fn decode_record(bytes: &[u8], queries: u32) -> Option<(Descriptor, Counts, &[u8])> {
    let (length, rest) = bytes.split_first()?;
    let (descriptor, rest) = rest.split_at_checked(usize::from(*length))?;
    let (object_correct, rest) = rest.split_first_chunk::<4>()?;
    let (category_correct, rest) = rest.split_first_chunk::<4>()?;
    let [object_correct, category_correct] =
        [object_correct, category_correct].map(|n| u32::from_le_bytes(*n));
    let counts = Counts { object_correct, category_correct, queries };
    // The same object is of the same category.
    let countable = object_correct <= category_correct && category_correct <= queries;
    countable.then_some((Descriptor::from_bytes(descriptor).ok()?, counts, rest))
}

#[cfg(test)]
mod tests {
    use descriptor::{Family, Parameters, SearchSpace};
    use proptest::prelude::*;

    use super::*;

    const QUERIES: u32 = 352;
    /// Length, tag and version before the genes of the paper's family; its genes and two counts.
    const RECORD_BYTES: usize = 3 + 5 * 4 + 2 * 4;
    const HEADER_BYTES: usize = MAGIC.len() + 4;

    /// A descriptor of any family, and counts.
    fn record() -> impl Strategy<Value = (Descriptor, Counts)> {
        let counts = (0..=QUERIES).prop_flat_map(|category| (0..=category, Just(category)));
        let colour = any::<bool>();
        let family = prop::sample::select(Family::ALL.to_vec());
        (family, colour, any::<[u16; 5]>(), counts).prop_map(|(family, colour, choices, counts)| {
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
            (descriptor, Counts { object_correct, category_correct, queries: QUERIES })
        })
    }

    fn some() -> Remembered {
        [(8, 3), (9, 7), (10, 5), (11, 7)]
            .map(|(shape_bins, object_correct)| {
                let counts = Counts { object_correct, category_correct: 20, queries: QUERIES };
                let parameters = Parameters { shape_bins, ..Parameters::PAPER_BEST };
                (Descriptor::DiskRing(parameters), counts)
            })
            .into()
    }

    proptest! {
        #[test]
        fn counts_are_read_as_they_were_written(known in prop::collection::vec(record(), 0..9)) {
            let known: Remembered = known.into_iter().collect();
            prop_assert_eq!(decode(&encode(&known, QUERIES), QUERIES), Ok(known));
        }

        #[test]
        fn arbitrary_bytes_are_refused_or_make_sense(
            tail in prop::collection::vec(any::<u8>(), 0..200),
            has_header in any::<bool>(),
        ) {
            let mut payload = if has_header { encode(&Remembered::new(), QUERIES) } else { Vec::new() };
            payload.extend(tail);
            if let Ok(known) = decode(&payload, QUERIES) {
                prop_assert_eq!(encode(&known, QUERIES), payload);
            }
        }
    }

    #[test]
    fn impossible_payloads_are_refused() {
        let sound = encode(&some(), QUERIES);
        assert_eq!(sound.len(), HEADER_BYTES + 4 * RECORD_BYTES);
        assert!(decode(&sound, QUERIES).is_ok());
        assert!(decode(&sound, QUERIES + 1).is_err());
        assert!(decode(&sound[..sound.len() - 1], QUERIES).is_err());
        let spoilt = |record: usize, field: usize, number: u32| {
            let mut payload = sound.clone();
            let at = HEADER_BYTES + record * RECORD_BYTES + 3 + 4 * field;
            payload[at..at + 4].copy_from_slice(&number.to_le_bytes());
            decode(&payload, QUERIES)
        };
        assert!(spoilt(1, 0, 9).is_ok());
        assert!(spoilt(1, 0, 8).is_err(), "the same descriptor twice");
        assert!(spoilt(1, 0, 12).is_err(), "order");
        assert!(spoilt(0, 0, 1).is_err(), "a gene outside its limits");
        assert!(spoilt(0, 5, 21).is_err(), "more objects than categories");
        assert!(spoilt(0, 6, QUERIES + 1).is_err(), "more categories than queries");
        let older = [b"counts 1", &sound[MAGIC.len()..]].concat();
        assert!(is_older(&older) && !is_older(&sound) && decode(&older, QUERIES).is_err());
    }

    #[test]
    fn what_is_too_much_loses_the_worst() {
        let mut known = some();
        let objects =
            |known: &Remembered| known.values().map(|counts| counts.object_correct).collect::<Vec<_>>();
        keep_best(&mut known, 3);
        assert_eq!(objects(&known), [7, 5, 7]);
        keep_best(&mut known, 1);
        assert_eq!(known, some().into_iter().skip(1).take(1).collect());
    }
}
