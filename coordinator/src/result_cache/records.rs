//! Remembered counts as bytes, and back: fixed-size records in the order of their descriptors.

use descriptor::{GENES, GeneKind, Parameters};
use results::Counts;

use super::Remembered;

/// First bytes of a payload; the number grows with every change of its form.
const MAGIC: &[u8; 8] = b"counts 1";
/// Magic and number of queries.
const HEADER_BYTES: usize = MAGIC.len() + 4;
/// Five genes in ticks, and the queries whose object and whose category was recognised.
const RECORD_BYTES: usize = 7 * 4;
/// Descriptors remembered for one matching: a whole entry is read when a run starts, and this many are 29 MB.
const MAX_RECORDS: usize = 1 << 20;

/// Leaves at most [`MAX_RECORDS`], those with most objects recognised: searches come back to good descriptors. What
/// is left does not depend on the order in which runs ended.
pub(super) fn truncate(known: &mut Remembered) {
    keep_best(known, MAX_RECORDS);
}

fn keep_best(known: &mut Remembered, most: usize) {
    if known.len() <= most {
        return;
    }
    let mut order: Vec<(Parameters, Counts)> = std::mem::take(known).into_iter().collect();
    // Stable: among equals the first descriptors stay.
    order.sort_by_key(|(_, counts)| std::cmp::Reverse(counts.object_correct));
    order.truncate(most);
    known.extend(order);
}

/// A payload for the store; every record has this number of queries.
pub(super) fn encode(known: &Remembered, queries: u32) -> Vec<u8> {
    let mut payload = Vec::with_capacity(HEADER_BYTES + known.len() * RECORD_BYTES);
    payload.extend_from_slice(MAGIC);
    payload.extend_from_slice(&queries.to_le_bytes());
    for (parameters, counts) in known {
        let genes = GENES.each_ref().map(|spec| parameters.ticks(spec.kind));
        for number in genes.into_iter().chain([counts.object_correct, counts.category_correct]) {
            payload.extend_from_slice(&number.to_le_bytes());
        }
    }
    payload
}

/// The inverse of [`encode`]; says what a payload is that it cannot have written for these queries.
pub(super) fn decode(payload: &[u8], queries: u32) -> Result<Remembered, String> {
    let rest = payload.strip_prefix(MAGIC).ok_or("another form")?;
    let (header, records) = rest.split_first_chunk::<4>().ok_or("no header")?;
    let of = u32::from_le_bytes(*header);
    if of != queries {
        return Err(format!("counts of {of} queries instead of {queries}"));
    }
    let (records, rest) = records.as_chunks::<RECORD_BYTES>();
    if !rest.is_empty() || records.len() > MAX_RECORDS {
        return Err(format!("{} bytes", payload.len()));
    }
    let mut last = None;
    let record = |record: &[u8; RECORD_BYTES]| {
        let (parameters, counts) = decode_record(record, queries).ok_or("an impossible record")?;
        if last.replace(parameters).is_some_and(|last| last >= parameters) {
            return Err("records out of order".to_owned());
        }
        Ok((parameters, counts))
    };
    records.iter().map(record).collect()
}

fn decode_record(record: &[u8; RECORD_BYTES], queries: u32) -> Option<(Parameters, Counts)> {
    let (numbers, _) = record.as_chunks::<4>();
    let [ticks @ .., object_correct, category_correct] =
        <[[u8; 4]; 7]>::try_from(numbers).ok()?.map(u32::from_le_bytes);
    let without_colour = ticks[GeneKind::ColourBins as usize] == 0;
    let possible = GENES.iter().zip(ticks).all(|(spec, ticks)| {
        let (low, high) = spec.limits;
        (low..=high).contains(&ticks) || spec.kind == GeneKind::ColourBins && without_colour
    });
    let counts = Counts { object_correct, category_correct, queries };
    // The same object is of the same category.
    let countable = object_correct <= category_correct && category_correct <= queries;
    (possible && countable).then(|| (Parameters::from_ticks(ticks), counts))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const QUERIES: u32 = 352;

    fn record() -> impl Strategy<Value = (Parameters, Counts)> {
        let genes = GENES.each_ref().map(|spec| spec.limits.0..=spec.limits.1);
        let counts = (0..=QUERIES).prop_flat_map(|category| (0..=category, Just(category)));
        (genes, any::<bool>(), counts).prop_map(|(mut ticks, colour, (object_correct, category_correct))| {
            if !colour {
                ticks[GeneKind::ColourBins as usize] = 0;
            }
            let counts = Counts { object_correct, category_correct, queries: QUERIES };
            (Parameters::from_ticks(ticks), counts)
        })
    }

    fn some() -> Remembered {
        [(8, 3), (9, 7), (10, 5), (11, 7)]
            .map(|(shape_bins, object_correct)| {
                let counts = Counts { object_correct, category_correct: 20, queries: QUERIES };
                (Parameters { shape_bins, ..Parameters::PAPER_BEST }, counts)
            })
            .into()
    }

    proptest! {
        #[test]
        fn counts_are_read_as_they_were_written(known in prop::collection::btree_map(0..9u32, record(), 0..9)) {
            let known: Remembered = known.into_values().collect();
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
        assert!(decode(&sound, QUERIES).is_ok());
        assert!(decode(&sound, QUERIES + 1).is_err());
        assert!(decode(&sound[..sound.len() - 1], QUERIES).is_err());
        let spoilt = |record: usize, field: usize, number: u32| {
            let mut payload = sound.clone();
            let at = HEADER_BYTES + record * RECORD_BYTES + 4 * field;
            payload[at..at + 4].copy_from_slice(&number.to_le_bytes());
            decode(&payload, QUERIES)
        };
        assert!(spoilt(1, 0, 8).is_err(), "the same descriptor twice");
        assert!(spoilt(1, 0, 12).is_err(), "order");
        assert!(spoilt(0, 0, 1).is_err(), "a gene outside its limits");
        assert!(spoilt(0, 5, 21).is_err(), "more objects than categories");
        assert!(spoilt(0, 6, QUERIES + 1).is_err(), "more categories than queries");
    }

    #[test]
    fn what_is_too_much_loses_the_worst() {
        let mut known = some();
        keep_best(&mut known, 3);
        let bins: Vec<u32> = known.keys().map(|parameters| parameters.shape_bins).collect();
        assert_eq!(bins, [9, 10, 11]);
        keep_best(&mut known, 1);
        assert_eq!(known.keys().next().map(|parameters| parameters.shape_bins), Some(9));
    }
}
