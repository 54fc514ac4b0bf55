//! What is done about a damaged journal: what is sound in it is taken, the rest is told, and the file is kept.

use std::fs::{File, OpenOptions};
use std::io::{self, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};

use super::contents::Contents;
use super::frame::scan;
use super::layout::Head;
use super::records::decode;
use super::results::RecordedResults;

/// A journal's file as it was read.
pub struct Salvaged {
    /// Its head.
    pub head: Head,
    /// What its sound records say.
    pub contents: Contents,
    /// The number of the next record.
    pub next_number: u64,
    /// Where the sound records end.
    pub end: u64,
    /// What is missing, if anything is.
    pub loss: Option<Loss>,
    /// Bytes at the end of a record of which not all was written.
    pub begun_bytes: u64,
}

/// What a damaged file has lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Loss {
    /// Records that hold.
    pub sound: usize,
    /// Records that are known to be missing; at the end of the file, nobody knows how many there were.
    pub records: u64,
    /// Bytes that are of no sound record.
    pub bytes: u64,
}

impl std::fmt::Display for Loss {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { sound, records, bytes } = self;
        write!(f, "{sound} records are sound, {records} or more are lost in {bytes} bytes")
    }
}

/// What is sound in a file; `None` if it has no head, so that nothing says what it was the journal of. Results are read
/// from `results`, the same file, when they are asked for.
///
/// No record is believed that may have been taken back later: what is taken back is not in the file any more.
///
/// # Errors
/// Those of the file system.
pub fn salvage(mut file: &File, results: File) -> io::Result<Option<Salvaged>> {
    let mut bytes = Vec::new();
    Head::most_of(file, &mut bytes)?;
    let Some((head, records, is_whole)) = Head::read(&bytes) else { return Ok(None) };
    drop(bytes);
    let (mut contents, mut unknown) = (Contents::new(RecordedResults::of(head.key, results)?), 0);
    file.seek(SeekFrom::Start(records as u64))?;
    let scanned = scan(&head.key, file, records as u64, |place, payload| match decode(payload) {
        Some(record) => contents.take(record, (place, payload.len())),
        None => unknown += 1,
    })?;
    // The first record is written with the head.
    let is_cut_in_head = scanned.records == 0;
    let is_damaged = !is_whole || is_cut_in_head || unknown > 0 || scanned.lost_bytes > scanned.begun_bytes;
    let loss = Loss {
        sound: scanned.records - unknown,
        records: scanned.lost_records + unknown as u64,
        bytes: scanned.lost_bytes,
    };
    let (next_number, end, begun_bytes) = (scanned.next_number, scanned.end, scanned.begun_bytes);
    Ok(Some(Salvaged { head, contents, next_number, end, loss: is_damaged.then_some(loss), begun_bytes }))
}

/// Copies a damaged file to a name beside it that nothing has, where people can look at it.
pub fn keep_damaged(path: &Path) -> io::Result<PathBuf> {
    let mut number = 1u32;
    let (place, mut copy) = loop {
        let place = path.with_extension(format!("damaged-{number}"));
        match OpenOptions::new().write(true).create_new(true).open(&place) {
            Ok(file) => break (place, file),
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists && number < 10_000 => number += 1,
            Err(error) => return Err(error),
        }
    };
    let copied = File::open(path).and_then(|mut file| io::copy(&mut file, &mut copy));
    if let Err(error) = copied.and_then(|_| copy.sync_all()) {
        let _ = std::fs::remove_file(&place); // half a copy helps nobody
        return Err(error);
    }
    Ok(place)
}
