//! Why a PLY file cannot be read, and what to do about it.

use crate::header_text::MAX_HEADER_BYTES;

/// What is wrong with a PLY file. The first line of the text is `where: what, got value`, the second says what to do.
/// Text from the file is cut short and escaped.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PlyError {
    /// No end of the header within the first 65536 bytes.
    #[error(
        "ply header: end_header: line expected within the first {} bytes, got none\n\
         the header is cut off, or its lines do not end with a line feed: copy or write the file again",
        MAX_HEADER_BYTES
    )]
    NoEnd,

    /// A line that is none of a header, or not where it may be.
    #[error(
        "ply header: line {line}: {expected}, got {got}\ncorrect the line, or write the file again as PLY 1.0"
    )]
    BadLine {
        /// Counted from 1.
        line: usize,
        /// What must be there.
        expected: &'static str,
        /// What is there.
        got: String,
    },

    /// No line that says how the elements are stored.
    #[error(
        "ply header: format: line expected, got none\nadd it after the first line, or write the file again as PLY 1.0"
    )]
    NoFormat,

    /// No points.
    #[error(
        "ply header: element vertex: line expected, got none\nwrite the points as the element vertex with the properties x, y and z"
    )]
    NoVertex,

    /// An element or a property of an element twice.
    #[error(
        "ply header: line {line}: each name once expected, got {name} again\nremove or rename one of them"
    )]
    Repeated {
        /// Of the second, counted from 1.
        line: usize,
        /// The name.
        name: String,
    },

    /// An element of which nothing is stored.
    #[error(
        "ply header: element {element}: properties expected, got none\nremove the element, or write the file again"
    )]
    NoProperties {
        /// Its name.
        element: String,
    },

    /// No x, y or z, or a colour without one of its three.
    #[error(
        "ply header: element vertex: property {name} expected, got none\nwrite the points with x, y and z, and colours with all three of their properties, or none"
    )]
    MissingProperty {
        /// The missing one.
        name: &'static str,
    },

    /// Colours by more than one of the three sets of names.
    #[error(
        "ply header: element vertex: colours once expected, got {first} and {second}\nremove one of them"
    )]
    TwoColours {
        /// Red in the first.
        first: &'static str,
        /// Red in the second.
        second: &'static str,
    },

    /// A position, colour or viewpoint of a type that none has.
    #[error("ply header: property {name}: {expected} expected, got {got}\nwrite the property with that type")]
    PropertyType {
        /// The property.
        name: &'static str,
        /// Types that it may have.
        expected: &'static str,
        /// Its type.
        got: String,
    },

    /// More than one camera.
    #[error(
        "ply header: element camera: at most 1 expected, got {got}\nremove the element: the viewpoint is then the origin"
    )]
    Cameras {
        /// How many.
        got: u64,
    },

    /// More rows than the bytes of the file can hold.
    #[error(
        "ply data: {rows} of element {element} of at least {row_bytes} bytes expected, got {available} bytes\nthe file is cut off or the counts of its elements are wrong: copy or write it again"
    )]
    Truncated {
        /// The element.
        element: String,
        /// Its count.
        rows: u64,
        /// Bytes a row; in ascii the fewest that its values can be written with.
        row_bytes: u64,
        /// Bytes from the element's start.
        available: usize,
    },

    /// The end of the file within an element.
    #[error(
        "ply data: element {element}: {rows} expected, got {got}\nthe file is cut off or the counts of its elements are wrong: copy or write it again"
    )]
    RowCount {
        /// The element.
        element: String,
        /// Its count.
        rows: u64,
        /// Complete ones.
        got: u64,
    },

    /// Something else than zero bytes or blank lines behind the last element.
    #[error(
        "ply data: end of file after the last element expected, got {extra} bytes more\nthe counts or the properties of its elements are wrong: correct the header or write the file again"
    )]
    TooMuchData {
        /// Bytes from the last row on.
        extra: usize,
    },

    /// A line of ascii data with more or fewer values than the properties need.
    #[error(
        "ply data: line {line}: {expected} values expected, got {got}\ncorrect the line, or write the file again"
    )]
    ValueCount {
        /// Counted from 1 at the start of the file.
        line: usize,
        /// Values of the element's properties, those of lists included.
        expected: u64,
        /// Values on the line.
        got: u64,
    },

    /// A value that is not of its property's type, or a colour out of range.
    #[error(
        "ply data: {place}: {name}: {expected} expected, got {got}\ncorrect the value, or write the file again"
    )]
    BadValue {
        /// `line N`, counted from 1 at the start of the file, or `row N` of the element, counted from 0.
        place: String,
        /// The property.
        name: String,
        /// What must be there.
        expected: &'static str,
        /// What is there.
        got: String,
    },
}
