//! Signatures: what a cloud is described by in one channel, and those of many clouds (DESIGN 5.7).

use pulp::NullaryFnOnce;

use crate::wide::widest;

/// Centroid and standard deviation of the rows of one channel, value by value.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Signature {
    /// Mean of the rows.
    pub centroid: Vec<f32>,
    /// Square root of the sum of squared differences from the mean over N − 1, 0 for a single row; empty in a channel
    /// that has one row a cloud by definition.
    pub deviation: Vec<f32>,
}

impl Signature {
    /// Centroid and deviation.
    pub(crate) fn parts(&self) -> [&[f32]; 2] {
        [&self.centroid, &self.deviation]
    }

    /// Of rows of `width` values that lie one after the other. Sums run in f64 in the order of the rows, the deviation
    /// in a second pass about the unrounded mean.
    pub fn of_rows(rows: &[f32], width: usize) -> Self {
        if width == 0 { Self::default() } else { widest(MeanAndDeviation { rows, width }) }
    }
}

/// The kernel of [`Signature::of_rows`].
pub(crate) struct MeanAndDeviation<'a> {
    pub(crate) rows: &'a [f32],
    pub(crate) width: usize,
}

impl NullaryFnOnce for MeanAndDeviation<'_> {
    type Output = Signature;

    #[inline(always)]
    fn call(self) -> Signature {
        let count = (self.rows.len() / self.width) as f64;
        let mut mean = sums(&self, std::iter::repeat(0.0), |value| value);
        mean.iter_mut().for_each(|sum| *sum /= count);
        let squares = sums(&self, mean.iter().copied(), |difference| difference * difference);
        let degrees = if count > 1.0 { count - 1.0 } else { 1.0 };
        Signature {
            centroid: mean.iter().map(|&mean| mean as f32).collect(),
            deviation: squares.iter().map(|&sum| (sum / degrees).sqrt() as f32).collect(),
        }
    }
}

/// Sums of a term of each value's difference from the centre of its column, by column and in the order of the rows. Four
/// rows are added at once, so that sums are read and written for all of them.
#[inline(always)]
fn sums(
    MeanAndDeviation { rows, width }: &MeanAndDeviation<'_>,
    centres: impl Iterator<Item = f64> + Clone,
    term: impl Fn(f64) -> f64,
) -> Vec<f64> {
    let mut sums = vec![0.0; *width];
    let fours = rows.chunks_exact(4 * width);
    let rest = fours.remainder();
    for four in fours {
        let (firsts, lasts) = four.split_at(2 * width);
        let ((a, b), (c, d)) = (firsts.split_at(*width), lasts.split_at(*width));
        let values = a.iter().zip(b).zip(c).zip(d);
        for ((sum, centre), (((&a, &b), &c), &d)) in sums.iter_mut().zip(centres.clone()).zip(values) {
            let term = |value: f32| term(f64::from(value) - centre);
            *sum = *sum + term(a) + term(b) + term(c) + term(d);
        }
    }
    for row in rest.chunks_exact(*width) {
        for ((sum, centre), &value) in sums.iter_mut().zip(centres.clone()).zip(row) {
            *sum += term(f64::from(value) - centre);
        }
    }
    sums
}

/// The signatures of several clouds in one channel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Signatures {
    /// Values of one centroid.
    pub(crate) bins: usize,
    /// Values of one cloud: its centroid, then its deviation.
    pub(crate) width: usize,
    pub(crate) clouds: usize,
    pub(crate) values: Vec<f32>,
    /// How many keypoints of each cloud are described; empty in families whose signatures do not tell.
    pub(crate) keypoints: Vec<u32>,
}

impl Signatures {
    /// Adds the clouds of `other` after these.
    ///
    /// # Panics
    /// If they are of another channel: a programming error.
    pub fn append(&mut self, other: &Self) {
        let is_alike = [self.bins, self.width] == [other.bins, other.width];
        assert!(self.clouds == 0 || other.clouds == 0 || is_alike, "signatures of different channels");
        (self.bins, self.width) = (self.bins.max(other.bins), self.width.max(other.width));
        self.clouds += other.clouds;
        self.values.extend_from_slice(&other.values);
        self.keypoints.extend_from_slice(&other.keypoints);
    }

    /// Number of clouds.
    pub fn clouds(&self) -> usize {
        self.clouds
    }

    /// How many keypoints of each cloud are described; `None` in families whose signatures do not tell. A cloud with 0
    /// has a signature of zeros.
    pub fn keypoints(&self) -> Option<&[u32]> {
        (!self.keypoints.is_empty()).then_some(&self.keypoints)
    }

    /// The clouds that are described at all: which they are, and their signatures.
    pub fn into_described(self) -> (Vec<u32>, Self) {
        let all = 0..self.clouds as u32;
        if !self.keypoints.contains(&0) {
            return (all.collect(), self);
        }
        let clouds: Vec<u32> = all.filter(|&cloud| self.keypoints[cloud as usize] > 0).collect();
        let rows = clouds.iter().flat_map(|&cloud| &self.values[cloud as usize * self.width..][..self.width]);
        let described = Self {
            bins: if clouds.is_empty() { 0 } else { self.bins },
            width: if clouds.is_empty() { 0 } else { self.width },
            clouds: clouds.len(),
            values: rows.copied().collect(),
            keypoints: clouds.iter().map(|&cloud| self.keypoints[cloud as usize]).collect(),
        };
        (clouds, described)
    }

    /// The first clouds, at most so many.
    pub fn first(&self, clouds: usize) -> Self {
        let clouds = clouds.min(self.clouds);
        Self {
            bins: self.bins,
            width: self.width,
            clouds,
            values: self.values[..clouds * self.width].to_vec(),
            keypoints: self.keypoints.iter().take(clouds).copied().collect(),
        }
    }

    /// One cloud's centroid and deviation.
    pub fn get(&self, cloud: usize) -> [&[f32]; 2] {
        let (centroid, deviation) = self.values[cloud * self.width..][..self.width].split_at(self.bins);
        [centroid, deviation]
    }

    /// One cloud's signature.
    ///
    /// # Panics
    /// As [`Signatures::get`].
    pub fn signature(&self, cloud: usize) -> Signature {
        let [centroid, deviation] = self.get(cloud).map(<[f32]>::to_vec);
        Signature { centroid, deviation }
    }

    /// Values of one centroid.
    pub fn bins(&self) -> usize {
        self.bins
    }

    /// Memory that the signatures take, bytes.
    pub fn bytes(&self) -> usize {
        size_of::<Self>() + size_of_val(self.values.as_slice()) + size_of_val(self.keypoints.as_slice())
    }
}

impl<'a> FromIterator<&'a Signature> for Signatures {
    fn from_iter<I: IntoIterator<Item = &'a Signature>>(signatures: I) -> Self {
        let mut all = Self::default();
        for Signature { centroid, deviation } in signatures {
            let layout = [centroid.len(), centroid.len() + deviation.len()];
            assert!(all.clouds == 0 || [all.bins, all.width] == layout, "signatures of different channels");
            [all.bins, all.width] = layout;
            all.clouds += 1;
            all.values.extend_from_slice(centroid);
            all.values.extend_from_slice(deviation);
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// A column's mean and standard deviation by their definitions, its values added in the order of the rows.
    fn plain(column: &[f32]) -> [f32; 2] {
        let sum = |term: &dyn Fn(f64) -> f64| column.iter().fold(0.0, |sum, &value| sum + term(value.into()));
        let mean = sum(&|value| value) / column.len() as f64;
        let degrees = (column.len() as f64 - 1.0).max(1.0);
        [mean as f32, (sum(&|value| (value - mean) * (value - mean)) / degrees).sqrt() as f32]
    }

    proptest! {
        /// To the bit, with any number of rows beside those that are added at once.
        #[test]
        fn a_signature_is_mean_and_deviation_of_each_column(
            (width, values) in (1usize..40, 1usize..14)
                .prop_flat_map(|(width, rows)| (Just(width), prop::collection::vec(0.0f32..1.0, width * rows))),
        ) {
            let Signature { centroid, deviation } = Signature::of_rows(&values, width);
            for column in 0..width {
                let values: Vec<f32> = values.iter().skip(column).step_by(width).copied().collect();
                prop_assert_eq!([centroid[column], deviation[column]], plain(&values));
            }
        }
    }
}
