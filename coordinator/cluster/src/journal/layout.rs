//! A journal's file as a whole: its head twice, each on pages of its own, then records.

use std::fs::File;
use std::io::{self, Read as _, Seek as _, SeekFrom, Write};

use super::Entry;
use super::contents::Contents;
use super::frame::{Key, PAGE, framed};
use super::records::{encode, padding};

/// Longest head that is looked for, bytes.
const MAX_HEAD: usize = 16 << 20;
/// Bytes that are written at once.
const CHUNK: usize = 1 << 20;

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
    pub fn most_of(mut file: &File, bytes: &mut Vec<u8>) -> io::Result<usize> {
        file.seek(SeekFrom::Start(0))?;
        file.take(2 * MAX_HEAD as u64).read_to_end(bytes)
    }

    /// Bytes of the pages that one copy takes.
    fn pages(&self) -> usize {
        framed(self.key.0.len() + self.header.len()).next_multiple_of(PAGE)
    }

    /// Writes a whole file; returns its length and the number of its next record. Who was quarantined stands at the
    /// beginning and, on other pages, at the end: it must not be forgotten, whichever page is lost.
    pub fn write(&self, contents: &Contents, out: impl Write) -> io::Result<(u64, u64)> {
        let mut bytes = Vec::new();
        for end in [self.pages(), 2 * self.pages()] {
            Key::PUBLIC.append(&mut bytes, 0, 0, &self.encode());
            bytes.resize(end, 0);
        }
        let mut writer = Writer { key: &self.key, out, bytes, written: 0, next_number: 0 };
        let quarantined = || contents.quarantined.iter().filter_map(|&id| encode(&Entry::Quarantined(id)));
        quarantined().try_for_each(|payload| writer.append(&payload))?;
        writer.append(&contents.tally.encode())?;
        contents.for_each_entry(|entry| encode(&entry).map_or(Ok(()), |payload| writer.append(&payload)))?;
        if !contents.quarantined.is_empty() {
            let (length, least) = (writer.length(), framed(1) as u64);
            let end = (length + least).next_multiple_of(PAGE as u64);
            writer.append(&padding((end - length) as usize - framed(0)))?;
            quarantined().try_for_each(|payload| writer.append(&payload))?;
            writer.append(&contents.tally.encode())?;
        }
        writer.flush()?;
        Ok((writer.length(), writer.next_number))
    }
}

/// Writes records one after the other.
struct Writer<'a, W> {
    key: &'a Key,
    out: W,
    /// What is not written yet.
    bytes: Vec<u8>,
    /// How much is.
    written: u64,
    next_number: u64,
}

impl<W: Write> Writer<'_, W> {
    fn append(&mut self, payload: &[u8]) -> io::Result<()> {
        self.key.append(&mut self.bytes, self.written, self.next_number, payload);
        self.next_number += 1;
        if self.bytes.len() < CHUNK { Ok(()) } else { self.flush() }
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.write_all(&self.bytes)?;
        self.written += self.bytes.len() as u64;
        self.bytes.clear();
        Ok(())
    }

    fn length(&self) -> u64 {
        self.written + self.bytes.len() as u64
    }
}
