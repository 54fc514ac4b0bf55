//! The form of a derived entry: a header that says what it is and who made it, then the payload, both under
//! checksums.

use proto::Digest;

const MAGIC: [u8; 8] = *b"\x89DESCRY\n";
const FORMAT_VERSION: u32 = 1;
/// Longest text of a header, bytes.
const MAX_TEXT: usize = 128;
/// The largest entry, header included, bytes. What is larger is computed again each time.
pub const MAX_ENTRY_BYTES: u64 = 256 << 20;

/// Why bytes are not the entry that was asked for.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Damage {
    /// There are fewer bytes than the entry says.
    #[error("is truncated")]
    Truncated,
    /// There are more bytes than the entry says, or than any entry has.
    #[error("is too long")]
    TooLong,
    /// These bytes were never an entry.
    #[error("is no entry")]
    Magic,
    /// It was made by a program that writes another format.
    #[error("has another format, {0}")]
    Format(u32),
    /// A bit of the header is wrong.
    #[error("has a damaged header")]
    Header,
    /// It was made under another evaluation version.
    #[error("is of another evaluation version, {0}")]
    EvaluationVersion(u32),
    /// It is a sound entry for something else.
    #[error("is another entry")]
    Foreign,
    /// A bit of the payload is wrong.
    #[error("has a damaged payload")]
    Payload,
}

/// Who made an entry, and for which run: for people who wonder where an entry comes from.
#[derive(Clone, Debug, Default)]
pub struct Origin {
    /// Program, version and host.
    pub producer: String,
    /// Session of the coordinator, or empty.
    pub run: String,
}

/// The header that goes before `payload`; `version` is the evaluation version that made it.
pub fn header(kind: &str, key: Digest, version: u32, origin: &Origin, payload: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(512);
    bytes.extend_from_slice(&MAGIC);
    bytes.extend_from_slice(&FORMAT_VERSION.to_le_bytes());
    bytes.extend_from_slice(&version.to_le_bytes());
    bytes.extend_from_slice(&key.0);
    bytes.extend_from_slice(&(payload.len() as u64).to_le_bytes());
    bytes.extend_from_slice(&Digest::of(payload).0);
    for text in [kind, &origin.producer, &origin.run] {
        let text = proto::truncate(text, MAX_TEXT).as_bytes();
        bytes.push(text.len() as u8);
        bytes.extend_from_slice(text);
    }
    let checksum = Digest::of(&bytes);
    bytes.extend_from_slice(&checksum.0);
    bytes
}

/// Takes an entry apart that must be the one of this kind, key and evaluation version; returns its payload.
///
/// # Errors
/// Whatever differs from what [`header`] wrote, wherever the bytes came from.
pub fn payload<'a>(bytes: &'a [u8], kind: &str, key: Digest, version: u32) -> Result<&'a [u8], Damage> {
    if bytes.len() as u64 > MAX_ENTRY_BYTES {
        return Err(Damage::TooLong);
    }
    let mut rest = Reader(bytes);
    if rest.array()? != MAGIC {
        return Err(Damage::Magic);
    }
    let format = u32::from_le_bytes(rest.array()?);
    if format != FORMAT_VERSION {
        return Err(Damage::Format(format));
    }
    let found_version = u32::from_le_bytes(rest.array()?);
    let found_key = Digest(rest.array()?);
    let length = u64::from_le_bytes(rest.array()?);
    let checksum = Digest(rest.array()?);
    let [found_kind, _producer, _run] = [rest.text()?, rest.text()?, rest.text()?];
    let header = &bytes[..bytes.len() - rest.0.len()];
    if Digest::of(header) != Digest(rest.array()?) {
        return Err(Damage::Header);
    }
    if found_version != version {
        return Err(Damage::EvaluationVersion(found_version));
    }
    if found_kind != kind.as_bytes() || found_key != key {
        return Err(Damage::Foreign);
    }
    let payload = rest.0;
    match (payload.len() as u64).cmp(&length) {
        std::cmp::Ordering::Less => Err(Damage::Truncated),
        std::cmp::Ordering::Greater => Err(Damage::TooLong),
        std::cmp::Ordering::Equal if Digest::of(payload) != checksum => Err(Damage::Payload),
        std::cmp::Ordering::Equal => Ok(payload),
    }
}

/// What is left of the bytes.
struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    fn take(&mut self, bytes: usize) -> Result<&'a [u8], Damage> {
        let (taken, rest) = self.0.split_at_checked(bytes).ok_or(Damage::Truncated)?;
        self.0 = rest;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], Damage> {
        self.take(N)?.try_into().map_err(|_| Damage::Truncated)
    }

    fn text(&mut self) -> Result<&'a [u8], Damage> {
        let [length] = self.array()?;
        self.take(usize::from(length))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KIND: &str = "test entry";
    const VERSION: u32 = 7;

    fn entry(payload: &[u8]) -> (Digest, Vec<u8>) {
        let key = Digest::of(b"key");
        let origin = Origin { producer: "descry 0.0.0 on here".to_owned(), run: "r".repeat(1000) };
        (key, [&header(KIND, key, VERSION, &origin, payload)[..], payload].concat())
    }

    #[test]
    fn an_entry_gives_its_payload_back() {
        for expected in [&b""[..], b"payload"] {
            let (key, bytes) = entry(expected);
            assert_eq!(payload(&bytes, KIND, key, VERSION), Ok(expected));
        }
    }

    #[test]
    fn every_truncation_is_found() {
        let (key, bytes) = entry(b"payload");
        for length in 0..bytes.len() {
            assert_eq!(payload(&bytes[..length], KIND, key, VERSION), Err(Damage::Truncated), "{length}");
        }
        assert_eq!(payload(&[&bytes[..], b"!"].concat(), KIND, key, VERSION), Err(Damage::TooLong));
    }

    #[test]
    fn every_flipped_bit_is_found() {
        let (key, bytes) = entry(b"payload");
        for bit in 0..bytes.len() * 8 {
            let mut flipped = bytes.clone();
            flipped[bit / 8] ^= 1 << (bit % 8);
            assert!(payload(&flipped, KIND, key, VERSION).is_err(), "{bit}");
        }
    }

    /// The entry with its header changed and its header's checksum made anew: a sound entry, but another one.
    fn resealed(bytes: &[u8], payload_bytes: usize, change: impl FnOnce(&mut [u8])) -> Vec<u8> {
        let (header, payload) = bytes.split_at(bytes.len() - payload_bytes);
        let mut header = header[..header.len() - 32].to_vec();
        change(&mut header);
        let checksum = Digest::of(&header);
        [&header[..], &checksum.0, payload].concat()
    }

    #[test]
    fn sound_entries_of_another_version_kind_or_key_are_foreign() {
        let (key, bytes) = entry(b"payload");
        assert_eq!(payload(&resealed(&bytes, 7, |_| {}), KIND, key, VERSION), Ok(&b"payload"[..]));
        let format = resealed(&bytes, 7, |header| header[8] = 2);
        assert_eq!(payload(&format, KIND, key, VERSION), Err(Damage::Format(2)));
        let next = VERSION + 1;
        let version = resealed(&bytes, 7, |header| header[12..16].copy_from_slice(&next.to_le_bytes()));
        assert_eq!(payload(&version, KIND, key, VERSION), Err(Damage::EvaluationVersion(next)));
        assert_eq!(payload(&bytes, "other kind", key, VERSION), Err(Damage::Foreign));
        assert_eq!(payload(&bytes, KIND, Digest::of(b"other key"), VERSION), Err(Damage::Foreign));
        let huge = resealed(&bytes, 7, |header| header[48..56].fill(0xff));
        assert_eq!(payload(&huge, KIND, key, VERSION), Err(Damage::Truncated));
    }
}
