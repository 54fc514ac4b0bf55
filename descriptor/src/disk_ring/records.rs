//! The neighbour records of a cloud of one feature, in as few bytes as they need.

use std::ops::Range;

/// As many codes as there can be: a table of so many is looked up without a check.
pub(crate) const CODES: usize = 1 << 16;

/// Most classes of which a position fits a byte.
const MAX_LISTED: usize = 256;

/// Codes of the classes of all records, and what they stand for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Records {
    /// Positions in a list of classes.
    Listed { classes: Vec<u16>, positions: Vec<u8> },
    /// The classes themselves.
    Plain(Vec<u16>),
}

impl Records {
    /// No records yet, of these classes, if they are few enough; otherwise of any.
    pub(crate) fn of_classes(classes: Vec<u16>) -> Self {
        if (1..=MAX_LISTED).contains(&classes.len()) {
            Self::Listed { classes, positions: Vec::new() }
        } else {
            Self::Plain(Vec::new())
        }
    }

    /// The list of classes; of plain records `None`.
    pub(crate) fn listed(&self) -> Option<&[u16]> {
        match self {
            Self::Listed { classes, .. } => Some(classes),
            Self::Plain(_) => None,
        }
    }

    /// The class that a code stands for. Classes ascend with their codes.
    pub(crate) fn class(&self, code: u16) -> u16 {
        self.listed().map_or(code, |classes| classes[usize::from(code)])
    }

    /// How many codes there are, if there are so many classes.
    pub(crate) fn codes(&self, classes: usize) -> usize {
        self.listed().map_or(classes, <[u16]>::len)
    }

    /// Of each of these classes the first code whose class is not below it.
    pub(crate) fn first_codes(&self, classes: &[u16]) -> impl Iterator<Item = u16> {
        let code = move |class: &u16| match self.listed() {
            Some(listed) => listed.partition_point(|listed| listed < class) as u16,
            None => *class,
        };
        classes.iter().map(code)
    }

    /// Adds one to a count of the code of each of these records, of consecutive ones to another of its two: a count that
    /// was just changed takes time until it can be changed again.
    #[inline(always)]
    pub(crate) fn count_in_turn(&self, records: Range<usize>, counts: &mut [[u32; 2]; CODES]) {
        match self {
            Self::Listed { positions, .. } => count_in_turn(&positions[records], counts),
            Self::Plain(classes) => count_in_turn(&classes[records], counts),
        }
    }

    /// Number of records.
    pub(crate) fn len(&self) -> usize {
        match self {
            Self::Listed { positions, .. } => positions.len(),
            Self::Plain(classes) => classes.len(),
        }
    }

    /// Memory that they take, bytes.
    pub(crate) fn bytes(&self) -> usize {
        match self {
            Self::Listed { classes, positions } => {
                size_of_val(classes.as_slice()) + size_of_val(positions.as_slice())
            }
            Self::Plain(classes) => size_of_val(classes.as_slice()),
        }
    }

    /// Adds records of these codes: positions in the list, if there is one.
    pub(crate) fn extend(&mut self, codes: &[u16]) {
        match self {
            Self::Listed { positions, .. } => positions.extend(codes.iter().map(|&position| position as u8)),
            Self::Plain(classes) => classes.extend_from_slice(codes),
        }
    }

    /// Gives memory back that was kept for more.
    pub(crate) fn shrink_to_fit(&mut self) {
        match self {
            Self::Listed { positions, .. } => positions.shrink_to_fit(),
            Self::Plain(classes) => classes.shrink_to_fit(),
        }
    }

    /// The records as bytes, in little-endian order.
    pub(crate) fn encode_to(&self, bytes: &mut Vec<u8>) {
        match self {
            Self::Listed { positions, .. } => bytes.extend_from_slice(positions),
            Self::Plain(classes) => bytes.extend(classes.iter().flat_map(|class| class.to_le_bytes())),
        }
    }

    /// Undoes [`Records::encode_to`], given the list (empty without) and how many classes there can be.
    ///
    /// # Errors
    /// What contradicts itself.
    pub(crate) fn decode(listed: Vec<u16>, bytes: &[u8], classes: usize) -> Result<Self, &'static str> {
        let below = |values: &[u16]| values.iter().max().is_none_or(|&most| usize::from(most) < classes);
        let (records, is_sound) = if listed.is_empty() {
            let plain: Vec<u16> =
                bytes.as_chunks::<2>().0.iter().map(|&class| u16::from_le_bytes(class)).collect();
            let is_sound = below(&plain);
            (Self::Plain(plain), is_sound)
        } else {
            let is_listed = bytes.iter().max().is_none_or(|&most| usize::from(most) < listed.len());
            let is_list = listed.len() <= MAX_LISTED && listed.is_sorted_by(|a, b| a < b) && below(&listed);
            (Self::Listed { classes: listed, positions: bytes.to_vec() }, is_list && is_listed)
        };
        if is_sound { Ok(records) } else { Err("records must be of the quantiser's classes") }
    }
}

#[inline(always)]
fn count_in_turn<C: Copy + Into<u16>>(codes: &[C], counts: &mut [[u32; 2]; CODES]) {
    let (pairs, last) = codes.as_chunks::<2>();
    for &[even, odd] in pairs {
        counts[usize::from(even.into())][0] += 1;
        counts[usize::from(odd.into())][1] += 1;
    }
    if let [last] = last {
        counts[usize::from((*last).into())][0] += 1;
    }
}
