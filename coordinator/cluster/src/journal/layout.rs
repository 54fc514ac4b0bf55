//! A journal's file as a whole: its head twice, each on pages of its own, then records.

use std::fs::File;
use std::io::{self, Read as _, Seek as _, SeekFrom};

use super::Entry;
use super::frame::{Key, PAGE, framed};
use super::records::{Contents, encode, padding};

/// Longest head that is looked for, bytes.
const MAX_HEAD: usize = 16 << 20;

/// What has to be read first.
#[derive(Clone, PartialEq, Eq)]
pub struct Head {
    /// The key of all records that follow.
    pub key: Key,
    /// The encoded header.
    pub header: Vec<u8>,
}

impl Head {
    fn encode(&self) -> Vec<u8> {
        [&self.key.0[..], &self.header].concat()
    }

    /// The head of a file, where its records begin, and whether both copies are sound; `None` if neither is.
    pub fn read(file: &[u8]) -> Option<(Self, usize, bool)> {
        let copy = |place: usize| {
            let (_, payload, _) = Key::PUBLIC.record(file, place)?;
            let (key, header) = payload.split_first_chunk()?;
            Some(Self { key: Key(*key), header: header.to_vec() })
        };
        let first = copy(0);
        let second = match &first {
            Some(first) => copy(first.pages()),
            None => {
                let places = (PAGE..file.len().min(MAX_HEAD)).step_by(PAGE);
                places.filter_map(|place| Some((place, copy(place)?))).find_map(|(place, copy)| {
                    (copy.pages() == place).then_some(copy) // a copy stands where its own length puts it
                })
            }
        };
        let is_whole = first.is_some() && first == second;
        let head = first.or(second)?;
        let records = 2 * head.pages();
        Some((head, records, is_whole))
    }

    /// Reads the bytes of a file in which its head must be.
    pub fn most_of(file: &mut File, bytes: &mut Vec<u8>) -> io::Result<usize> {
        file.seek(SeekFrom::Start(0))?;
        file.take(2 * MAX_HEAD as u64).read_to_end(bytes)
    }

    /// Bytes of the pages that one copy takes.
    fn pages(&self) -> usize {
        framed(self.key.0.len() + self.header.len()).next_multiple_of(PAGE)
    }

    /// A whole file, and the number of its next record. Who was quarantined stands at the beginning and, on other pages,
    /// at the end: it must not be forgotten, whichever page is lost.
    pub fn file(&self, contents: &Contents) -> (Vec<u8>, u64) {
        let mut bytes = Vec::new();
        for end in [self.pages(), 2 * self.pages()] {
            Key::PUBLIC.append(&mut bytes, 0, 0, &self.encode());
            bytes.resize(end, 0);
        }
        let mut next_number = 0;
        let mut append = |payload: Vec<u8>, bytes: &mut Vec<u8>| {
            self.key.append(bytes, 0, next_number, &payload);
            next_number += 1;
        };
        let quarantined = || contents.quarantined.iter().filter_map(|&id| encode(&Entry::Quarantined(id)));
        quarantined().for_each(|payload| append(payload, &mut bytes));
        append(contents.tally.encode(), &mut bytes);
        contents.entries().filter_map(|entry| encode(&entry)).for_each(|payload| append(payload, &mut bytes));
        if !contents.quarantined.is_empty() {
            let least = framed(1);
            let end = (bytes.len() + least).next_multiple_of(PAGE);
            append(padding(end - bytes.len() - framed(0)), &mut bytes);
            quarantined().for_each(|payload| append(payload, &mut bytes));
            append(contents.tally.encode(), &mut bytes);
        }
        (bytes, next_number)
    }
}
