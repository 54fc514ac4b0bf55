//! Canonical bytes of descriptors and search spaces: a family's tag, a version, then numbers (u32, little-endian).

use crate::family::Family;

/// Version of the numbers that follow, of every family so far.
const VERSION: u8 = 1;

/// Why bytes are no descriptor or no search space.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BytesError {
    /// Not even a tag and a version.
    #[error("{what}: at least 2 bytes expected, got {got}\nuse programs of the same release")]
    TooShort {
        /// What should have been read.
        what: &'static str,
        /// Number of bytes.
        got: usize,
    },
    /// The tag of no family.
    #[error("{what}: tag of a family expected, got {got}\nuse programs of the same release")]
    Family {
        /// What should have been read.
        what: &'static str,
        /// The first byte.
        got: u8,
    },
    /// Written in another way.
    #[error("{what}: version {VERSION} of {family} expected, got {got}\nuse programs of the same release")]
    Version {
        /// What should have been read.
        what: &'static str,
        /// Its family.
        family: Family,
        /// The second byte.
        got: u8,
    },
    /// More or fewer numbers than the family has.
    #[error("{what}: {expected} bytes of {family} expected, got {got}\nuse programs of the same release")]
    Length {
        /// What should have been read.
        what: &'static str,
        /// Its family.
        family: Family,
        /// After tag and version.
        expected: usize,
        /// After tag and version.
        got: usize,
    },
    /// No settings of preprocessing.
    #[error(
        "preparation: version {version} of 5 settings and a search space expected, got {got} other bytes\nuse programs of the same release"
    )]
    Settings {
        /// The only version so far.
        version: u8,
        /// Number of bytes.
        got: usize,
    },
    /// A search space with colour, and clouds without.
    #[error("preparation: clouds with colour expected, got clouds without\nuse programs of the same release")]
    Colour,
    /// Numbers that nothing of the family has.
    #[error("{what}: values of {family} expected, got {reason}")]
    Values {
        /// What should have been read.
        what: &'static str,
        /// Its family.
        family: Family,
        /// What is wrong with them, and what to do.
        reason: String,
    },
}

/// Writes the numbers of one of a family.
pub(crate) fn write(family: Family, numbers: impl IntoIterator<Item = u32>) -> Vec<u8> {
    let mut bytes = vec![family.tag(), VERSION];
    bytes.extend(numbers.into_iter().flat_map(u32::to_le_bytes));
    bytes
}

/// What was read of canonical bytes: tag and version.
pub(crate) struct Reader<'a> {
    what: &'static str,
    /// The family that the tag names.
    pub(crate) family: Family,
    rest: &'a [u8],
}

impl<'a> Reader<'a> {
    /// Reads tag and version of `what`.
    ///
    /// # Errors
    /// If they are none that this release writes.
    pub(crate) fn new(what: &'static str, bytes: &'a [u8]) -> Result<Self, BytesError> {
        let [tag, version, rest @ ..] = bytes else {
            return Err(BytesError::TooShort { what, got: bytes.len() });
        };
        let family = Family::ALL.into_iter().find(|family| family.tag() == *tag);
        let family = family.ok_or(BytesError::Family { what, got: *tag })?;
        if *version != VERSION {
            return Err(BytesError::Version { what, family, got: *version });
        }
        Ok(Self { what, family, rest })
    }

    /// The numbers, which must be so many.
    ///
    /// # Errors
    /// If they are not.
    pub(crate) fn numbers<const N: usize>(&self) -> Result<[u32; N], BytesError> {
        let wrong = |_| {
            let (expected, got) = (4 * N, self.rest.len());
            BytesError::Length { what: self.what, family: self.family, expected, got }
        };
        self.all_numbers().map_err(drop).and_then(|numbers| numbers.try_into().map_err(drop)).map_err(wrong)
    }

    /// The numbers, however many there are.
    ///
    /// # Errors
    /// If the last one is not whole.
    pub(crate) fn all_numbers(&self) -> Result<Vec<u32>, BytesError> {
        let (numbers, rest) = self.rest.as_chunks::<4>();
        if !rest.is_empty() {
            return Err(self.refuse(format!(
                "{} bytes, which are no whole numbers\nuse programs of the same release",
                self.rest.len()
            )));
        }
        Ok(numbers.iter().map(|&bytes| u32::from_le_bytes(bytes)).collect())
    }

    /// That the numbers are none that anything of the family has.
    pub(crate) fn refuse(&self, reason: impl Into<String>) -> BytesError {
        BytesError::Values { what: self.what, family: self.family, reason: reason.into() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_read_in_whole() {
        let bytes = write(Family::DiskRing, [7, u32::MAX]);
        let reader = Reader::new("descriptor", &bytes).unwrap();
        assert_eq!(reader.all_numbers(), Ok(vec![7, u32::MAX]));
        assert_eq!(reader.numbers(), Ok([7, u32::MAX]));
        assert_eq!(Reader::new("descriptor", &bytes[..2]).unwrap().all_numbers(), Ok(vec![]));

        let cut = Reader::new("descriptor", &bytes[..9]).unwrap();
        assert_eq!(
            cut.all_numbers().unwrap_err().to_string(),
            "descriptor: values of disk-ring expected, got 7 bytes, which are no whole numbers\n\
             use programs of the same release"
        );
        for cut in [cut, Reader::new("descriptor", &bytes[..6]).unwrap()] {
            assert!(matches!(cut.numbers::<2>(), Err(BytesError::Length { expected: 8, .. })));
        }
    }
}
