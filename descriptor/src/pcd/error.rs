//! Why a PCD file cannot be read, and what to do about it.

use crate::header_text::{MAX_HEADER_BYTES, UNIT};

/// What is wrong with a PCD file. The first line of the text is `where: what, got value`, the second says what
/// to do. Text from the file is cut short and escaped.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PcdError {
    /// No line break or no DATA line within the first 65536 bytes.
    #[error(
        "pcd header: DATA: line expected within the first {} bytes, got none\n\
         the file is not a PCD file, or its header is cut off",
        MAX_HEADER_BYTES
    )]
    NoDataLine,

    /// A header line that is not text.
    #[error(
        "pcd header: line {line}: UTF-8 text expected, got other bytes\n\
         the file is not a PCD file, or it is damaged: write it again"
    )]
    NotText {
        /// Counted from 1.
        line: usize,
    },

    /// A header line that starts with none of the known words.
    #[error(
        "pcd header: line {line}: one of VERSION, FIELDS, SIZE, TYPE, COUNT, WIDTH, HEIGHT, VIEWPOINT, POINTS, DATA expected, got {got}\n\
         remove the line or put # in front of it"
    )]
    UnknownLine {
        /// Counted from 1.
        line: usize,
        /// Its first word.
        got: String,
    },

    /// A header line that is there twice.
    #[error("pcd header: {keyword}: one line expected, got another at line {line}\nkeep the right one")]
    RepeatedLine {
        /// Its first word.
        keyword: &'static str,
        /// Of the second, counted from 1.
        line: usize,
    },

    /// A header line that is not there.
    #[error("pcd header: {keyword}: line expected, got none\nadd it, or write the file again as PCD 0.7")]
    MissingLine {
        /// Its first word.
        keyword: &'static str,
    },

    /// A header line whose values are not what they must be.
    #[error(
        "pcd header: {keyword}: {expected}, got {got}\ncorrect the line, or write the file again as PCD 0.7"
    )]
    BadLine {
        /// Its first word.
        keyword: &'static str,
        /// What must be there.
        expected: &'static str,
        /// What is there.
        got: String,
    },

    /// SIZE, TYPE or COUNT with more or fewer values than FIELDS has names.
    #[error(
        "pcd header: {keyword}: {expected} values expected, one for each of FIELDS, got {got}\n\
         correct the line, or write the file again as PCD 0.7"
    )]
    FieldCount {
        /// Its first word.
        keyword: &'static str,
        /// Number of fields.
        expected: usize,
        /// Number of values.
        got: usize,
    },

    /// No x, y or z.
    #[error("pcd header: FIELDS: x, y and z expected, got no {name}\nwrite the cloud with its positions")]
    MissingField {
        /// The missing one.
        name: &'static str,
    },

    /// Two fields of one name.
    #[error("pcd header: FIELDS: each name once expected, got {name} twice\nremove or rename one of them")]
    RepeatedField {
        /// The name.
        name: String,
    },

    /// Both `rgb` and `rgba`.
    #[error("pcd header: FIELDS: rgb or rgba expected, got both\nremove one of them")]
    TwoColours,

    /// A position or colour of a type that none has.
    #[error(
        "pcd header: {name}: {expected} expected, got {got}\nwrite the field with that size, type and count"
    )]
    FieldType {
        /// The field.
        name: String,
        /// Types that it may have.
        expected: &'static str,
        /// Its type, size and count.
        got: String,
    },

    /// POINTS that is not WIDTH × HEIGHT.
    #[error(
        "pcd header: POINTS: WIDTH × HEIGHT = {width} × {height} expected, got {points}\n\
         correct the wrong one of the three"
    )]
    PointCount {
        /// WIDTH.
        width: u64,
        /// HEIGHT.
        height: u64,
        /// POINTS.
        points: u64,
    },

    /// More points than the bytes of the file can hold.
    #[error(
        "pcd data: {points} points of at least {point_bytes} bytes expected, got {available} bytes\n\
         the file is cut off or its WIDTH, HEIGHT and POINTS are wrong: copy or write it again"
    )]
    Truncated {
        /// POINTS.
        points: u64,
        /// Bytes a point; in ascii the fewest that its values can be written with.
        point_bytes: u64,
        /// Bytes after the header.
        available: usize,
    },

    /// Something else than zero bytes (to which some writers pad) after the last point.
    #[error(
        "pcd data: end of file after {points} points expected, got {extra} bytes more\n\
         WIDTH, HEIGHT and POINTS or the fields are wrong: correct the header or write the file again"
    )]
    TooMuchData {
        /// POINTS.
        points: usize,
        /// Bytes after the last point.
        extra: usize,
    },

    /// Other number of lines than POINTS says.
    #[error(
        "pcd data: {expected} points expected, got {got}\n\
         the file is cut off or its WIDTH, HEIGHT and POINTS are wrong: copy or write it again"
    )]
    LineCount {
        /// POINTS.
        expected: usize,
        /// Lines with values.
        got: usize,
    },

    /// A line of ascii data with more or fewer values than the fields need.
    #[error(
        "pcd data: line {line}: {expected} values expected, got {got}\n\
         correct the line, or write the file again"
    )]
    ValueCount {
        /// Counted from 1 at the start of the file.
        line: usize,
        /// Sum of COUNT.
        expected: usize,
        /// Values on the line.
        got: usize,
    },

    /// A position or colour that is not a number of its field's type.
    #[error(
        "pcd data: line {line}: {name}: {expected} expected, got {got}\ncorrect the value, or write the file again"
    )]
    BadValue {
        /// Counted from 1 at the start of the file.
        line: usize,
        /// The field.
        name: &'static str,
        /// What must be there.
        expected: &'static str,
        /// What is there.
        got: String,
    },

    /// A separate colour value of binary data that is out of range.
    #[error(
        "pcd data: point {point}: {name}: {unit} expected, got {got}\ndivide colours by 255, or write them as U1",
        unit = UNIT
    )]
    BadColour {
        /// Counted from 0.
        point: usize,
        /// The field.
        name: &'static str,
        /// What is there.
        got: String,
    },

    /// binary_compressed without its two sizes.
    #[error(
        "pcd data: compressed and uncompressed size (8 bytes) expected, got {available} bytes\n\
         the file is cut off: copy or write it again"
    )]
    NoSizes {
        /// Bytes after the header.
        available: usize,
    },

    /// A compressed size beyond the end of the file.
    #[error(
        "pcd data: {compressed} compressed bytes expected, got {available}\n\
         the file is cut off or damaged: copy or write it again"
    )]
    CompressedTruncated {
        /// Size stated before the data.
        compressed: u32,
        /// Bytes after the sizes.
        available: usize,
    },

    /// An uncompressed size that is not POINTS × bytes a point.
    #[error(
        "pcd data: uncompressed size {expected} expected from the header, got {got}\n\
         WIDTH, HEIGHT and POINTS or the fields are wrong: correct the header or write the file again"
    )]
    UncompressedSize {
        /// From the header.
        expected: u64,
        /// Size stated before the data.
        got: u32,
    },

    /// More than a file that is not compressed could have.
    #[error(
        "pcd data: at most {most} uncompressed bytes expected, got {got}\ncut out the object, or thin the cloud"
    )]
    TooLarge {
        /// The most.
        most: u32,
        /// Size stated before the data.
        got: u32,
    },

    /// An uncompressed size that LZF cannot reach.
    #[error(
        "pcd data: at most {limit} bytes from {compressed} compressed ones expected, got {got}\n\
         the file is damaged: copy or write it again"
    )]
    Expansion {
        /// The most that LZF can make of them.
        limit: u64,
        /// Size stated before the data.
        compressed: u32,
        /// Uncompressed size stated before the data.
        got: u32,
    },

    /// LZF data that breaks the format or ends at another size than stated.
    #[error(
        "pcd data: {expected} bytes of LZF data expected, got damaged ones\ncopy or write the file again"
    )]
    BadLzf {
        /// Uncompressed size stated before the data.
        expected: u32,
    },
}
