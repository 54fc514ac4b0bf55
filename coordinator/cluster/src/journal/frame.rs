//! Records in a file: each with its length, number and a keyed checksum, so that it is found and believed on its own.
//!
//! The checksum covers where in the file a record stands. Its key is as old as the file and known to nobody else, so that
//! nothing that a peer has sent, and nothing that another file has left on the disk, can pass for a record.

use std::io::{self, Read};

/// Pages of disks and file systems; what is kept twice lies in different ones.
pub const PAGE: usize = 4096;
/// Numbers are below: no file has as many records.
const MAX_NUMBER: u64 = 1 << 53;
/// Mark, length, number, checksum.
const HEAD: usize = 4 + 4 + 8 + 16;
/// The mark and the length, by which a record of which not all was written is known.
const BEGINNING: usize = 8;
/// Bytes of a file that are read at once.
const CHUNK: usize = 1 << 20;

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

    /// Whether so many bytes at the end of a file, of which the first are these, are what a record leaves of which not all
    /// was written.
    fn is_begun(&self, beginning: &[u8], length: u64) -> bool {
        match self.head(beginning) {
            Some((payload, _)) => length < framed(payload) as u64,
            None => {
                beginning.len() < BEGINNING
                    && beginning.iter().zip(self.mark()).all(|(have, begins)| *have == begins)
            }
        }
    }
}

/// Bytes that a payload takes in a file.
pub const fn framed(payload: usize) -> usize {
    HEAD + payload
}

/// What the records of a file come to, from some place on.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Scanned {
    /// Sound records.
    pub records: usize,
    /// The number of the record after the last.
    pub next_number: u64,
    /// Where the last sound record ends.
    pub end: u64,
    /// Records that are missing between sound ones.
    pub lost_records: u64,
    /// Bytes that are of no sound record.
    pub lost_bytes: u64,
    /// Of these, at the end, the bytes of a record of which not all was written: no damage, but the end of a process.
    pub begun_bytes: u64,
}

/// Reads a file from `start` on, where the record numbered 0 should be and `reader` is, and shows the place and the payload
/// of each sound record to `see`, in order. Bytes that are of no record are passed over. No more of the file is in memory
/// than a record and what is read at once, unless a damaged record is said to be long.
///
/// # Errors
/// Those of the reader.
pub fn scan(key: &Key, reader: impl Read, start: u64, see: impl FnMut(u64, &[u8])) -> io::Result<Scanned> {
    scan_by(CHUNK, key, reader, start, see)
}

fn scan_by(
    chunk: usize,
    key: &Key,
    reader: impl Read,
    start: u64,
    mut see: impl FnMut(u64, &[u8]),
) -> io::Result<Scanned> {
    let mut window = Window { reader, chunk, bytes: Vec::new(), passed: 0, place: start };
    let mut scanned = Scanned { end: start, ..Scanned::default() };
    // Of what follows the last sound record.
    let mut beginning = Vec::new();
    loop {
        let payload = key.head(window.at_least(HEAD)?).map_or(0, |(length, _)| length);
        let bytes = window.at_least(framed(payload))?;
        if bytes.is_empty() {
            break;
        }
        let place = window.place;
        let bytes = window.rest();
        if let Some((number, payload)) = key.first_record(bytes, place)
            && (scanned.next_number..MAX_NUMBER).contains(&number)
        {
            scanned.lost_records += number - scanned.next_number;
            scanned.lost_bytes += place - scanned.end;
            scanned.records += 1;
            see(place, payload);
            let length = framed(payload.len());
            (scanned.next_number, scanned.end) = (number + 1, place + length as u64);
            beginning.clear();
            window.pass(length);
        } else {
            if place == scanned.end {
                beginning = bytes[..bytes.len().min(BEGINNING)].to_vec();
            }
            window.pass(1);
            window.pass_to(&key.mark())?;
        }
    }
    let rest = window.place - scanned.end;
    scanned.lost_bytes += rest;
    scanned.begun_bytes = if key.is_begun(&beginning, rest) { rest } else { 0 };
    Ok(scanned)
}

/// The part of a file that is looked at, which moves forward.
struct Window<R> {
    reader: R,
    /// Bytes that are read at once.
    chunk: usize,
    bytes: Vec<u8>,
    /// Of these, those that are behind.
    passed: usize,
    /// Where in the file the first of the others is.
    place: u64,
}

impl<R: Read> Window<R> {
    /// What is there, not less than so many bytes unless the file ends before.
    fn at_least(&mut self, least: usize) -> io::Result<&[u8]> {
        while self.rest().len() < least && self.read()? {}
        Ok(self.rest())
    }

    fn rest(&self) -> &[u8] {
        &self.bytes[self.passed..]
    }

    /// Reads on; `false` at the end of the file.
    fn read(&mut self) -> io::Result<bool> {
        self.bytes.drain(..std::mem::take(&mut self.passed));
        let read = (&mut self.reader).take(self.chunk as u64).read_to_end(&mut self.bytes)?;
        Ok(read > 0)
    }

    fn pass(&mut self, bytes: usize) {
        self.passed += bytes;
        self.place += bytes as u64;
    }

    /// Goes to the next place where these bytes are, or to the end of the file.
    fn pass_to(&mut self, wanted: &[u8]) -> io::Result<()> {
        loop {
            let rest = self.rest();
            if let Some(steps) = rest.windows(wanted.len()).position(|window| window == wanted) {
                self.pass(steps);
                return Ok(());
            }
            // The last of what is there may begin it.
            let steps = (rest.len() + 1).saturating_sub(wanted.len());
            self.pass(steps);
            if !self.read()? {
                self.pass(self.rest().len());
                return Ok(());
            }
        }
    }
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

    /// What a file has, which must not depend on how much of it is read at once.
    fn scan(file: &[u8], start: usize) -> (Vec<Vec<u8>>, Scanned) {
        let by = |chunk| {
            let mut payloads = Vec::new();
            let see = |place, payload: &[u8]| {
                assert_eq!(KEY.record(file, place as usize).map(|(_, there, _)| there), Some(payload));
                payloads.push(payload.to_vec());
            };
            let scanned = scan_by(chunk, &KEY, &file[start..], start as u64, see).unwrap();
            assert_eq!(scanned.records, payloads.len());
            (payloads, scanned)
        };
        let scanned = by(CHUNK);
        assert!([1, 7, 50].map(by).iter().all(|other| *other == scanned));
        scanned
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
        assert!(scan(&outer, 0).0.is_empty());
    }

    #[test]
    fn what_is_lost_is_counted() {
        let payloads: Vec<Vec<u8>> = (0u8..9).map(|byte| vec![byte; 10]).collect();
        let mut file = file(3, &payloads);
        let one = framed(10);
        let (_, scanned) = scan(&file, 3);
        assert_eq!((scanned.lost_bytes, scanned.next_number), (0, 9));
        file[3 + 4 * one + 20..][..one].fill(0);
        let (left, scanned) = scan(&file, 3);
        assert_eq!((scanned.lost_records, scanned.lost_bytes, scanned.begun_bytes), (2, 2 * one as u64, 0));
        assert_eq!(left, [0, 1, 2, 3, 6, 7, 8].map(|at: usize| payloads[at].clone()));
        assert_eq!((scanned.next_number, scanned.end), (9, file.len() as u64));
    }

    proptest! {
        #[test]
        fn a_file_that_ends_anywhere_has_what_is_before_and_an_unfinished_record(
            payloads in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..40), 0..9),
            cut in any::<prop::sample::Index>(),
        ) {
            let whole = file(6, &payloads);
            let (left, scanned) = scan(&whole, 6);
            prop_assert_eq!((left.len(), scanned.lost_bytes), (payloads.len(), 0));
            let cut = 6 + cut.index(whole.len() - 5);
            let (left, scanned) = scan(&whole[..cut], 6);
            prop_assert_eq!(&left[..], &payloads[..left.len()]);
            prop_assert_eq!((scanned.lost_records, scanned.lost_bytes), (0, scanned.begun_bytes));
            prop_assert_eq!(scanned.end + scanned.begun_bytes, cut as u64);
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
            let (left, _) = scan(&bytes, 6);
            let mut written = payloads.iter();
            prop_assert!(left.iter().all(|payload| written.any(|one| one == payload)));
        }
    }
}
