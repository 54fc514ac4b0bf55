//! Bytes as one LZ4 block: most bins of most histograms are empty or alike, so that descriptions take about a third of their
//! bytes on their way and where they are kept.

use std::sync::Arc;

use lz4_flex::block;

/// Bytes as one LZ4 block. Equal bytes may have different blocks: what names bytes is their own digest.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Compressed {
    block: Arc<[u8]>,
    length: u32,
}

/// A block that is none of so many bytes.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("lz4 block: must hold {length} bytes, got {what}")]
pub struct InvalidBlock {
    length: u32,
    what: String,
}

impl Compressed {
    /// Compresses bytes; `None` if they are more than an LZ4 block may have, 2 GiB.
    pub fn new(bytes: &[u8]) -> Option<Self> {
        let length = i32::try_from(bytes.len()).ok()?.unsigned_abs();
        Some(Self { block: block::compress(bytes).into(), length })
    }

    /// A block from elsewhere, which may hold anything.
    pub fn of_block(block: Vec<u8>, length: u32) -> Self {
        Self { block: block.into(), length }
    }

    /// The block.
    pub fn block(&self) -> &[u8] {
        &self.block
    }

    /// How many bytes it is said to hold.
    pub fn length(&self) -> u32 {
        self.length
    }

    /// The bytes; as much memory as it is said to hold is taken before.
    ///
    /// # Errors
    /// If the block does not hold as many bytes as it is said to.
    pub fn decompress(&self) -> Result<Vec<u8>, InvalidBlock> {
        let invalid = |what| InvalidBlock { length: self.length, what };
        let mut bytes = vec![0; self.length as usize];
        match block::decompress_into(&self.block, &mut bytes) {
            Ok(got) if got == bytes.len() => Ok(bytes),
            Ok(got) => Err(invalid(got.to_string())),
            Err(error) => Err(invalid(error.to_string())),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn bytes_come_back_and_no_others(bytes in prop::collection::vec(0u8..4, 0..2000)) {
            let compressed = Compressed::new(&bytes).unwrap();
            prop_assert_eq!(compressed.decompress(), Ok(bytes.clone()));
            for length in [bytes.len() + 1, bytes.len().saturating_sub(1)] {
                let other = Compressed::of_block(compressed.block().to_vec(), length as u32);
                prop_assert_eq!(other.decompress().is_ok(), length == bytes.len());
            }
        }

        #[test]
        fn whatever_a_block_is_it_gives_what_was_asked_for_or_an_error(
            block in prop::collection::vec(any::<u8>(), 0..300),
            length in 0u32..5000,
        ) {
            if let Ok(bytes) = Compressed::of_block(block, length).decompress() {
                prop_assert_eq!(bytes.len(), length as usize);
            }
        }
    }

    /// An example of the format's description: a literal, then 19 bytes and more that repeat it.
    #[test]
    fn a_block_is_what_the_format_says() {
        let mut block = vec![0x1f, b'a', 1, 0, 5, 0x50];
        block.extend(b"bbbbb");
        let expected = [vec![b'a'; 1 + 19 + 5], vec![b'b'; 5]].concat();
        assert_eq!(Compressed::of_block(block, 30).decompress(), Ok(expected));
    }
}
