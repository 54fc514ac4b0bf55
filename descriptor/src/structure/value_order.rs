//! What a table has of each point, and in which order.

use std::ops::Range;

use crate::structure::feature::Feature;
use crate::structure::quads::QUAD;

/// What is computed of each point's colour once for all of its pairs.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Column {
    /// What is subtracted.
    Difference(Feature),
    /// What is divided.
    Ratio(Feature),
    /// The bins of features of a single point, as their part of a code.
    Code(Vec<PointAxis>),
}

/// A feature of the second point.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct PointAxis {
    pub(super) feature: Feature,
    pub(super) edges: Vec<f32>,
    /// By how much the code grows from bin to bin.
    pub(super) stride: u32,
}

/// Where the values of a point are: first those of which a pair needs the difference alone, then those that it needs of
/// both points, which begin a quad. Codes, needed of its second point, fill the gap between them and follow: a quad that
/// is fetched brings as much as it can.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct ValueOrder {
    /// Number of values, with the gap if anything follows it.
    pub(super) values: usize,
    /// Position and columns of differences, which are the first.
    pub(super) differences: usize,
    /// Normal, if a feature is made of normals, and columns of ratios. Where there are none it is empty, and may begin
    /// after the last value.
    pub(super) of_both: Range<usize>,
    /// Where each column is.
    columns: Vec<usize>,
}

impl ValueOrder {
    /// Of points with a position and these columns, and with a normal or not.
    pub(super) fn new(columns: &[Column], has_normal: bool) -> Self {
        let count = |is_wanted: fn(&Column) -> bool| columns.iter().filter(|it| is_wanted(it)).count();
        let differences = 3 + count(|it| matches!(it, Column::Difference(_)));
        let ratios = count(|it| matches!(it, Column::Ratio(_)));
        let normal = differences.next_multiple_of(QUAD);
        let first_ratio = normal + if has_normal { 3 } else { 0 };
        let of_both = normal..first_ratio + ratios;

        let mut of_differences = 3..differences;
        let mut of_ratios = first_ratio..of_both.end;
        let mut of_codes = (differences..normal).chain(of_both.end..);
        let place = |column: &Column| match column {
            Column::Difference(_) => of_differences.next(),
            Column::Ratio(_) => of_ratios.next(),
            Column::Code(_) => of_codes.next(),
        };
        let columns: Vec<usize> = columns.iter().filter_map(place).collect();
        let without_codes = if of_both.is_empty() { differences } else { of_both.end };
        let values = columns.iter().fold(without_codes, |values, place| values.max(place + 1));
        Self { values, differences, of_both, columns }
    }

    /// Where a column is among the values.
    #[inline(always)]
    pub(super) fn place(&self, column: usize) -> usize {
        self.columns[column]
    }

    /// Where the normal is among the values, if there is one.
    #[inline(always)]
    pub(super) fn normal(&self) -> usize {
        self.of_both.start
    }

    /// Which values of a quad are differences; the others of the first quads are codes, or none.
    #[inline(always)]
    pub(super) fn are_differences(&self, quad: usize) -> [bool; QUAD] {
        [0, 1, 2, 3].map(|value| quad * QUAD + value < self.differences)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::structure::channel::StructureChannel;
    use crate::structure::group::MAX_VALUES;

    fn column() -> impl Strategy<Value = Column> {
        let columns =
            [Column::Difference(Feature::O1), Column::Ratio(Feature::RatioRed), Column::Code(Vec::new())];
        prop::sample::select(columns.to_vec())
    }

    proptest! {
        #[test]
        fn every_value_has_a_place_that_its_use_allows(
            columns in prop::collection::vec(column(), 0..=StructureChannel::MAX_AXES),
            has_normal: bool,
        ) {
            let order = ValueOrder::new(&columns, has_normal);
            let mut taken = vec![0, 1, 2];
            if has_normal {
                taken.extend(order.normal()..order.normal() + 3);
            }
            for (number, column) in columns.iter().enumerate() {
                let place = order.place(number);
                let is_difference = place < order.differences;
                let is_of_both = order.of_both.contains(&place);
                prop_assert_eq!(is_difference, matches!(column, Column::Difference(_)));
                prop_assert_eq!(is_of_both, matches!(column, Column::Ratio(_)));
                taken.push(place);
            }
            prop_assert!(order.of_both.start.is_multiple_of(QUAD) && order.differences <= order.of_both.start);
            let count = taken.len();
            taken.sort_unstable();
            taken.dedup();
            prop_assert_eq!(taken.len(), count, "no place is taken twice");
            prop_assert_eq!(taken.last(), Some(&(order.values - 1)));
            prop_assert!(order.values - count < QUAD && order.values <= MAX_VALUES);
        }
    }

    #[test]
    fn codes_fill_the_gap_before_the_normal() {
        let columns = [Column::Code(Vec::new()), Column::Ratio(Feature::RatioRed), Column::Code(Vec::new())];
        let order = ValueOrder::new(&columns, true);
        assert_eq!([0, 1, 2].map(|column| order.place(column)), [3, 7, 8]);
        assert_eq!((order.normal(), order.values), (4, 9));
        assert_eq!([0, 1].map(|quad| order.are_differences(quad)), [[true, true, true, false], [false; 4]]);
        assert_eq!(ValueOrder::new(&columns[..1], false).values, 4);
    }
}
