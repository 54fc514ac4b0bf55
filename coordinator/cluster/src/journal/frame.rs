//! Records in a file: each with its length, number and a keyed checksum, so that it is found and believed on its own.
//!
//! The checksum covers where in the file a record stands. Its key is as old as the file and known to nobody else, so that
//! nothing that a peer has sent, and nothing that another file has left on the disk, can pass for a record.

/// Pages of disks and file systems; what is kept twice lies in different ones.
pub const PAGE: usize = 4096;
/// Numbers are below: no file has as many records.
const MAX_NUMBER: u64 = 1 << 53;
/// Mark, length, number, checksum.
const HEAD: usize = 4 + 4 + 8 + 16;

/// The key of one file's checksums.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Key(pub [u8; 32]);

impl Key {
    /// The key of what has to be read before a file's own key is known.
    pub const PUBLIC: Self = Self(*b"descry journal, what it is of...");

    /// Begins each record.
    fn mark(&self) -> [u8; 4] {
        let [a, b, c, d, ..] = blake3::derive_key("descry journal: mark of a record", &self.0);
        [a, b, c, d]
    }

    fn checksum(&self, place: u64, number: u64, payload: &[u8]) -> [u8; 16] {
        let mut hasher = blake3::Hasher::new_keyed(&self.0);
        for number in [place, number, payload.len() as u64] {
            hasher.update(&number.to_le_bytes());
        }
        let mut checksum = [0; 16];
        checksum.copy_from_slice(&hasher.update(payload).finalize().as_bytes()[..16]);
        checksum
    }

    /// Appends a record to `bytes`, the first of which stands at `start` in the file.
    pub fn append(&self, bytes: &mut Vec<u8>, start: u64, number: u64, payload: &[u8]) {
        let place = start + bytes.len() as u64;
        bytes.extend(self.mark());
        bytes.extend((payload.len() as u32).to_le_bytes());
        bytes.extend(number.to_le_bytes());
        bytes.extend(self.checksum(place, number, payload));
        bytes.extend(payload);
    }

    /// The record at `place` of a file: its number, its payload, and where the next begins.
    pub fn record<'a>(&self, file: &'a [u8], place: usize) -> Option<(u64, &'a [u8], usize)> {
        let (number, payload) = self.first_record(file.get(place..)?, place as u64)?;
        Some((number, payload, place + framed(payload.len())))
    }

    /// The record that bytes of a file begin with, which stand at `place` in it: its number and its payload.
    pub fn first_record<'a>(&self, bytes: &'a [u8], place: u64) -> Option<(u64, &'a [u8])> {
        let (length, rest) = self.head(bytes)?;
        let (number, rest) = rest.split_first_chunk()?;
        let (checksum, rest) = rest.split_first_chunk::<16>()?;
        let payload = rest.get(..length)?;
        let number = u64::from_le_bytes(*number);
        let sound = self.checksum(place, number, payload) == *checksum;
        sound.then_some((number, payload))
    }

    /// The length of the payload, if `bytes` begin as a record, and what follows.
    fn head<'a>(&self, bytes: &'a [u8]) -> Option<(usize, &'a [u8])> {
        let (length, rest) = bytes.strip_prefix(&self.mark())?.split_first_chunk()?;
        Some((u32::from_le_bytes(*length) as usize, rest))
    }

    /// Whether `rest`, the end of a file, is what a record leaves of which not all was written.
    fn is_begun(&self, rest: &[u8]) -> bool {
        match self.head(rest) {
            Some((length, _)) => rest.len() < HEAD + length,
            None => rest.len() < 8 && rest.iter().zip(self.mark()).all(|(have, begins)| *have == begins),
        }
    }
}

/// Bytes that a payload takes in a file.
pub const fn framed(payload: usize) -> usize {
    HEAD + payload
}

/// The records of a file from some place on.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Scanned<'a> {
    /// Payloads of sound records, in order.
    pub payloads: Vec<&'a [u8]>,
    /// The number of the record after the last.
    pub next_number: u64,
    /// Where the last sound record ends.
    pub end: usize,
    /// Records that are missing between sound ones.
    pub lost_records: u64,
    /// Bytes that are of no sound record.
    pub lost_bytes: usize,
    /// Of these, at the end, the bytes of a record of which not all was written: no damage, but the end of a process.
    pub begun_bytes: usize,
}

/// Reads `file` from `start` on, where the record numbered 0 should be. Bytes that are of no record are passed over.
pub fn scan<'a>(key: &Key, file: &'a [u8], start: usize) -> Scanned<'a> {
    let mut scanned = Scanned { end: start.min(file.len()), ..Scanned::default() };
    let mut place = scanned.end;
    while place < file.len() {
        if let Some((number, payload, next)) = key.record(file, place)
            && (scanned.next_number..MAX_NUMBER).contains(&number)
        {
            scanned.lost_records += number - scanned.next_number;
            scanned.lost_bytes += place - scanned.end;
            scanned.payloads.push(payload);
            (scanned.next_number, scanned.end, place) = (number + 1, next, next);
        } else {
            let mark = key.mark();
            let further = file[place + 1..].windows(mark.len()).position(|window| window == mark);
            place = further.map_or(file.len(), |steps| place + 1 + steps);
        }
    }
    let rest = &file[scanned.end..];
    scanned.lost_bytes += rest.len();
    scanned.begun_bytes = if key.is_begun(rest) { rest.len() } else { 0 };
    scanned
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const KEY: Key = Key([7; 32]);

    /// A file that begins with `head` bytes of something else.
    fn file(head: usize, payloads: &[Vec<u8>]) -> Vec<u8> {
        let mut bytes = vec![0; head];
        for (number, payload) in (0..).zip(payloads) {
            KEY.append(&mut bytes, 0, number, payload);
        }
        bytes
    }

    #[test]
    fn what_is_of_another_place_key_or_number_is_no_record() {
        let file = file(5, &[b"one".to_vec(), b"two".to_vec()]);
        let (number, payload, next) = KEY.record(&file, 5).unwrap();
        assert_eq!((number, payload, next), (0, &b"one"[..], 5 + framed(3)));
        assert_eq!(KEY.record(&file, next).unwrap().0, 1);
        assert_eq!(KEY.record(&file[5..], 0), None, "another place");
        assert_eq!(Key([8; 32]).record(&file, 5), None, "another key");
        let mut renumbered = file.clone();
        renumbered[5 + 8] = 1;
        assert_eq!(KEY.record(&renumbered, 5), None, "another number");
        // A record within a record is none, although somebody may have sent it.
        let mut inner = Vec::new();
        Key::PUBLIC.append(&mut inner, 0, 0, b"quarantined: nobody");
        let mut outer = super::tests::file(0, &[inner]);
        outer[20] ^= 1;
        assert!(scan(&KEY, &outer, 0).payloads.is_empty());
    }

    #[test]
    fn what_is_lost_is_counted() {
        let payloads: Vec<Vec<u8>> = (0u8..9).map(|byte| vec![byte; 10]).collect();
        let mut file = file(3, &payloads);
        let one = framed(10);
        assert_eq!((scan(&KEY, &file, 3).lost_bytes, scan(&KEY, &file, 3).next_number), (0, 9));
        file[3 + 4 * one + 20..][..one].fill(0);
        let scanned = scan(&KEY, &file, 3);
        assert_eq!((scanned.lost_records, scanned.lost_bytes, scanned.begun_bytes), (2, 2 * one, 0));
        assert_eq!(scanned.payloads, [0, 1, 2, 3, 6, 7, 8].map(|at: usize| &payloads[at][..]));
        assert_eq!((scanned.next_number, scanned.end), (9, file.len()));
    }

    proptest! {
        #[test]
        fn a_file_that_ends_anywhere_has_what_is_before_and_an_unfinished_record(
            payloads in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..40), 0..9),
            cut in any::<prop::sample::Index>(),
        ) {
            let whole = file(6, &payloads);
            let scanned = scan(&KEY, &whole, 6);
            prop_assert_eq!((scanned.payloads.len(), scanned.lost_bytes), (payloads.len(), 0));
            let cut = cut.index(whole.len() + 1);
            let scanned = scan(&KEY, &whole[..cut], 6);
            prop_assert_eq!(&scanned.payloads[..], &payloads[..scanned.payloads.len()]);
            prop_assert_eq!((scanned.lost_records, scanned.lost_bytes), (0, scanned.begun_bytes));
            prop_assert_eq!(scanned.end + scanned.begun_bytes, cut);
        }

        #[test]
        fn damage_anywhere_takes_records_and_alters_none(
            payloads in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..40), 1..9),
            damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..20),
        ) {
            let mut bytes = file(6, &payloads);
            for (place, byte) in damage {
                let place = place.index(bytes.len());
                bytes[place] = byte;
            }
            let scanned = scan(&KEY, &bytes, 6);
            let mut left = payloads.iter();
            prop_assert!(scanned.payloads.iter().all(|payload| left.any(|written| written == payload)));
        }
    }
}
