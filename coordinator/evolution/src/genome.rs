//! The genome: what is searched over, as a table of fields, and the mapping between bits and value indices.

use std::ops::Range;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How value indices are written as bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase", rename = "encoding")]
pub enum Encoding {
    /// Plain binary, most significant bit first (paper).
    #[default]
    Binary,
    /// Reflected Gray code, most significant bit first: neighbouring codes differ in one bit.
    Gray,
}

/// One field of a genome: a choice between `values` values, which only the caller knows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Field {
    /// Its name.
    pub name: String,
    /// Number of values, at least 1.
    pub values: u32,
    /// Whether neighbouring value indices stand for values that are alike, such as 7 and 8 bins. Categories are in no
    /// order.
    pub ordered: bool,
    /// Fields of one slot are exchanged together by crossover by slots, and mutation by slot changes those of one only;
    /// `None`: the field is a slot of its own.
    pub slot: Option<u32>,
}

impl Field {
    /// An ordered field that is a slot of its own.
    pub fn new(name: &str, values: u32) -> Self {
        Self { name: name.to_owned(), values, ordered: true, slot: None }
    }

    /// Bits of the field in a chromosome: ⌈log₂ values⌉, none for a single value.
    pub fn bits(&self) -> u32 {
        u32::BITS - (self.values - 1).leading_zeros()
    }
}

/// The search space: fields in chromosome order.
///
/// A chromosome is the fields' bits, field after field, most significant bit first. A field of b bits with n values
/// whose bits read k (after undoing Gray coding) has value index ⌊k·n/2^b⌋, so every bit string is valid.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Genome {
    fields: Vec<Field>,
    encoding: Encoding,
}

impl Genome {
    /// A genome of these fields, in this order.
    ///
    /// # Panics
    /// If a field has no value: a programming error.
    pub fn new(fields: Vec<Field>, encoding: Encoding) -> Self {
        assert!(fields.iter().all(|field| field.values > 0), "a field without values");
        Self { fields, encoding }
    }

    /// The fields, in chromosome order.
    pub fn fields(&self) -> &[Field] {
        &self.fields
    }

    /// How value indices are written as bits.
    pub fn encoding(&self) -> Encoding {
        self.encoding
    }

    /// Bits of a chromosome.
    pub fn bits(&self) -> usize {
        self.fields.iter().map(|field| field.bits() as usize).sum()
    }

    /// Each field with the place of its bits in a chromosome.
    pub fn fields_with_bits(&self) -> impl Iterator<Item = (&Field, Range<usize>)> {
        let mut end = 0;
        self.fields.iter().map(move |field| {
            let start = end;
            end += field.bits() as usize;
            (field, start..end)
        })
    }

    /// The slots in the order of their first fields, each with the places of its fields' bits.
    pub fn slots(&self) -> Vec<Vec<Range<usize>>> {
        let mut slots: Vec<(Option<u32>, Vec<Range<usize>>)> = Vec::new();
        for (field, bits) in self.fields_with_bits() {
            match slots.iter_mut().find(|(slot, _)| slot.is_some() && *slot == field.slot) {
                Some((_, places)) => places.push(bits),
                None => slots.push((field.slot, vec![bits])),
            }
        }
        slots.into_iter().map(|(_, places)| places).collect()
    }

    /// The value index of each field, below its number of values.
    ///
    /// # Panics
    /// If `chromosome` has not [`Genome::bits`] bits: a programming error, as chromosomes never come from outside.
    pub fn decode(&self, chromosome: &[bool]) -> Vec<u32> {
        assert_eq!(chromosome.len(), self.bits(), "chromosome length");
        self.fields_with_bits().map(|(field, bits)| self.read(field, &chromosome[bits])).collect()
    }

    /// The value index that the bits of one field stand for.
    pub(crate) fn read(&self, field: &Field, bits: &[bool]) -> u32 {
        let (mut code, mut previous) = (0u64, false);
        for &bit in bits {
            previous = match self.encoding {
                Encoding::Binary => bit,
                Encoding::Gray => bit ^ previous,
            };
            code = code << 1 | u64::from(previous);
        }
        ((code * u64::from(field.values)) >> field.bits()) as u32
    }

    /// A chromosome that [`Genome::decode`] turns into these value indices: of several the one with the lowest code in
    /// each field.
    ///
    /// # Panics
    /// If there is not one index for each field, below its number of values: a programming error.
    pub fn encode(&self, values: &[u32]) -> Vec<bool> {
        assert_eq!(values.len(), self.fields.len(), "one value index for each field");
        let mut chromosome = vec![false; self.bits()];
        for ((field, bits), &value) in self.fields_with_bits().zip(values) {
            self.write(field, value, &mut chromosome[bits]);
        }
        chromosome
    }

    /// Sets the bits of one field to the lowest code that [`Genome::read`] turns into this value index.
    ///
    /// # Panics
    /// If the field has no such index: a programming error.
    pub(crate) fn write(&self, field: &Field, value: u32, bits: &mut [bool]) {
        assert!(value < field.values, "{}: value index {value} of {}", field.name, field.values);
        // The lowest k with ⌊k·n/2^b⌋ = value.
        let code = (u64::from(value) << field.bits()).div_ceil(u64::from(field.values));
        let code = match self.encoding {
            Encoding::Binary => code,
            Encoding::Gray => code ^ code >> 1,
        };
        for (bit, place) in bits.iter_mut().zip((0..field.bits()).rev()) {
            *bit = code >> place & 1 == 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use proptest::prelude::*;

    use super::*;

    const ENCODINGS: [Encoding; 2] = [Encoding::Binary, Encoding::Gray];

    fn genome(values: &[u32], encoding: Encoding) -> Genome {
        let field = |(index, &values): (usize, &u32)| Field::new(&format!("field {index}"), values);
        Genome::new(values.iter().enumerate().map(field).collect(), encoding)
    }

    /// Every bit string of a length, in ascending order of the number it reads as.
    fn bit_strings(length: usize) -> impl Iterator<Item = Vec<bool>> {
        (0..1u64 << length).map(move |number| (0..length).rev().map(|bit| number >> bit & 1 == 1).collect())
    }

    /// The value index of one field by its definition: k from its bits by the book, then ⌊k·n/2^b⌋.
    fn defined(bits: &[bool], values: u32, encoding: Encoding) -> u32 {
        let parity = |upto: usize| bits[..=upto].iter().filter(|&&bit| bit).count() % 2 == 1;
        let bit = |index: usize| match encoding {
            Encoding::Binary => bits[index],
            Encoding::Gray => parity(index),
        };
        let k: u64 = (0..bits.len()).map(|index| u64::from(bit(index)) << (bits.len() - 1 - index)).sum();
        (k * u64::from(values) / (1u64 << bits.len())) as u32
    }

    #[test]
    fn bits_are_the_fewest_that_tell_the_values_apart() {
        for (values, bits) in
            [(1, 0), (2, 1), (3, 2), (4, 2), (5, 3), (57, 6), (64, 6), (65, 7), (101, 7), (u32::MAX, 32)]
        {
            assert_eq!(genome(&[values], Encoding::Binary).bits(), bits, "{values}");
        }
        assert_eq!(genome(&[57, 6, 16, 30, 101], Encoding::Binary).bits(), 25);
        assert_eq!(genome(&[], Encoding::Gray).decode(&[]), Vec::<u32>::new());
    }

    #[test]
    fn a_single_field_is_its_definition_for_every_bit_string_and_every_index() {
        for encoding in ENCODINGS {
            for values in 1..=70 {
                let genome = genome(&[values], encoding);
                let mut seen: BTreeMap<u32, Vec<Vec<bool>>> = BTreeMap::new();
                for bits in bit_strings(genome.bits()) {
                    let decoded = genome.decode(&bits);
                    assert_eq!(decoded, [defined(&bits, values, encoding)]);
                    seen.entry(decoded[0]).or_default().push(bits);
                }
                // Every index, each by ⌊2^b/n⌋ bit strings or one more.
                assert_eq!(seen.keys().copied().collect::<Vec<_>>(), (0..values).collect::<Vec<_>>());
                let floor = (1usize << genome.bits()) / values as usize;
                assert!(seen.values().all(|strings| (floor..=floor + 1).contains(&strings.len())));
                if encoding == Encoding::Binary {
                    for (index, strings) in seen {
                        assert_eq!(genome.encode(&[index]), strings[0], "{index} of {values}");
                    }
                }
            }
        }
    }

    #[test]
    fn gray_neighbours_differ_in_one_bit() {
        let genome = genome(&[64], Encoding::Gray);
        for index in 1..64 {
            let [before, after] = [index - 1, index].map(|index| genome.encode(&[index]));
            assert_eq!(before.iter().zip(&after).filter(|(a, b)| a != b).count(), 1, "{index}");
        }
    }

    #[test]
    fn slots_are_in_the_order_of_their_first_fields_and_a_field_without_is_its_own() {
        let field = |values, slot| Field { slot, ..Field::new("field", values) };
        let fields = [
            field(4, Some(7)),
            field(5, None),
            field(1, Some(2)),
            field(2, Some(7)),
            field(2, None),
            field(9, Some(2)),
        ];
        let genome = Genome::new(fields.into(), Encoding::Binary);
        assert_eq!(format!("{:?}", genome.slots()), "[[0..2, 5..6], [2..5], [5..5, 7..11], [6..7]]");
        assert_eq!(genome.bits(), 11);
        let fields: Vec<u32> = genome.fields_with_bits().map(|(field, _)| field.values).collect();
        assert_eq!(fields, [4, 5, 1, 2, 2, 9]);
        assert!(Genome::new(Vec::new(), Encoding::Gray).slots().is_empty());
    }

    #[test]
    #[should_panic(expected = "chromosome length")]
    fn a_chromosome_of_another_length_is_a_programming_error() {
        genome(&[4, 4], Encoding::Binary).decode(&[true; 3]);
    }

    #[test]
    #[should_panic(expected = "field 1: value index 4 of 4")]
    fn an_index_beyond_its_field_is_a_programming_error() {
        genome(&[4, 4], Encoding::Binary).encode(&[3, 4]);
    }

    proptest! {
        #[test]
        fn fields_stand_side_by_side_in_order(
            values in prop::collection::vec(1u32..9, 0..5),
            number in any::<u64>(),
        ) {
            for encoding in ENCODINGS {
                let genome = genome(&values, encoding);
                let chromosome: Vec<bool> = (0..genome.bits()).map(|bit| number >> bit & 1 == 1).collect();
                let mut rest = &chromosome[..];
                let expected: Vec<u32> = genome.fields().iter().map(|field| {
                    let (bits, tail) = rest.split_at(field.bits() as usize);
                    rest = tail;
                    defined(bits, field.values, encoding)
                }).collect();
                prop_assert_eq!(genome.decode(&chromosome), expected);
            }
        }

        #[test]
        fn indices_are_encoded_by_the_lowest_code_that_reads_as_them(
            table in prop::collection::vec((1u32..12, any::<u32>()), 0..4),
        ) {
            let values: Vec<u32> = table.iter().map(|(values, _)| *values).collect();
            let indices: Vec<u32> = table.iter().map(|(values, draw)| draw % values).collect();
            let [binary, gray] = ENCODINGS.map(|encoding| genome(&values, encoding));
            // In binary the lowest code of every field is the lowest bit string of all.
            let lowest = bit_strings(binary.bits()).find(|bits| binary.decode(bits) == indices);
            prop_assert_eq!(Some(binary.encode(&indices)), lowest);
            prop_assert_eq!(gray.decode(&gray.encode(&indices)), indices.clone());
            // Gray writes the same codes: bit by bit, each the exclusive or with the bit before it in its field.
            let mut rest = binary.encode(&indices);
            let mut expected = Vec::new();
            for field in binary.fields() {
                let tail = rest.split_off(field.bits() as usize);
                let before = std::iter::once(&false).chain(&rest);
                expected.extend(before.zip(&rest).map(|(before, bit)| before ^ bit));
                rest = tail;
            }
            prop_assert_eq!(gray.encode(&indices), expected);
        }

        #[test]
        fn large_fields_decode_inside_themselves_and_back(values in 1u32.., draw in any::<u32>()) {
            for encoding in ENCODINGS {
                let genome = genome(&[values], encoding);
                let index = draw % values;
                prop_assert_eq!(genome.decode(&genome.encode(&[index])), [index]);
                let bits: Vec<bool> = (0..genome.bits()).map(|bit| draw >> bit & 1 == 1).collect();
                prop_assert!(genome.decode(&bits)[0] < values);
            }
        }
    }
}
