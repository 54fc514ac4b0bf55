//! What every Parquet file of this project says of itself: its table, the version of its columns, and a checksum.
//!
//! The checksum (`descry.checksum`) is BLAKE3 over the whole file with the checksum's own 64 digits read as zeros. It is
//! checked before anything is decoded: a flipped bit in a value would not be noticed at all, and decoders trust lengths
//! that they read.

/// Version of the column table. Readers accept this and earlier ones.
pub const SCHEMA_VERSION: u32 = 1;

/// Key of [`SCHEMA_VERSION`].
pub const VERSION_KEY: &str = "descry.schema_version";
/// Key of the table's name.
pub const TABLE_KEY: &str = "descry.table";
/// Key of the columns, as JSON.
pub const COLUMNS_KEY: &str = "descry.columns";
/// Key of the checksum, which is the last.
pub const CHECKSUM_KEY: &str = "descry.checksum";

const MAGIC: &[u8] = b"PAR1";
const DIGITS: usize = 64;

/// The checksum of a file that has none yet.
pub const BLANK: &str = "0000000000000000000000000000000000000000000000000000000000000000";

/// Why a file's metadata cannot be believed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum MetadataError {
    /// The bytes are not those that were written: what is wrong.
    Damaged(String),
    /// A file of another program, without this key.
    Missing(&'static str),
    /// A file of a later version.
    Newer(u32),
}

/// Writes the checksum into the bytes of a file whose metadata end with [`CHECKSUM_KEY`] and [`BLANK`].
///
/// # Errors
/// If the bytes are no such file.
pub fn seal(bytes: &mut [u8]) -> Result<(), MetadataError> {
    let at = checksum_position(bytes)?;
    let checksum = blake3::hash(bytes).to_hex();
    bytes[at..at + DIGITS].copy_from_slice(checksum.as_bytes());
    Ok(())
}

/// Checks the checksum of a file, and leaves [`BLANK`] in its place.
///
/// # Errors
/// If it is not that of the content.
pub fn check(bytes: &mut [u8]) -> Result<(), MetadataError> {
    let at = checksum_position(bytes)?;
    let recorded = bytes[at..at + DIGITS].to_vec();
    bytes[at..at + DIGITS].copy_from_slice(BLANK.as_bytes());
    if blake3::hash(bytes).to_hex().as_bytes() != recorded {
        return Err(MetadataError::Damaged("its checksum is not that of its content".to_owned()));
    }
    Ok(())
}

/// Checks the value of [`VERSION_KEY`].
///
/// # Errors
/// If it is no version, or a later one.
pub fn check_version(value: &str) -> Result<(), MetadataError> {
    match value.parse::<u32>() {
        Ok(version) if (1..=SCHEMA_VERSION).contains(&version) => Ok(()),
        Ok(got) if got > SCHEMA_VERSION => Err(MetadataError::Newer(got)),
        _ => Err(MetadataError::Damaged(format!("its {VERSION_KEY} is no version"))),
    }
}

/// Position of the checksum's digits. Thrift writes a text after its field header (0x18) and length, and the
/// metadata follows everything else of the footer that could repeat the key.
fn checksum_position(bytes: &[u8]) -> Result<usize, MetadataError> {
    let damaged = |what: &str| MetadataError::Damaged(what.to_owned());
    let Some(body) = bytes.strip_suffix(MAGIC).filter(|body| body.starts_with(MAGIC)) else {
        return Err(damaged("it does not begin and end as Parquet does"));
    };
    let footer = body.split_last_chunk().and_then(|(body, length)| {
        let start = body.len().checked_sub(u32::from_le_bytes(*length) as usize)?;
        Some((start, &body[start..]))
    });
    let Some((start, footer)) = footer else {
        return Err(damaged("its footer is longer than the file"));
    };
    let needle = [CHECKSUM_KEY.as_bytes(), &[0x18, DIGITS as u8]].concat();
    let at = footer.windows(needle.len()).rposition(|window| window == needle);
    let at = at.map(|at| start + at + needle.len()).filter(|at| at + DIGITS <= start + footer.len());
    at.ok_or(MetadataError::Missing(CHECKSUM_KEY))
}
