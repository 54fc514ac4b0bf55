//! How clouds are prepared for all descriptors of a search space, and its canonical bytes.

use crate::bytes::BytesError;
use crate::preprocess::{Preprocess, Unit};
use crate::search_space::SearchSpace;

/// Version of the settings that follow.
const VERSION: u8 = 1;

/// What is computed of a cloud once for all descriptors of a search space.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Preparation {
    /// Keypoints and normals.
    pub preprocess: Preprocess,
    /// What clouds are prepared for.
    pub space: SearchSpace,
}

impl Preparation {
    /// Canonical bytes: version, settings (u32, little-endian), then those of the search space.
    pub fn to_bytes(&self) -> Vec<u8> {
        let Preprocess { leaf_um, normal_radius_um, min_points, colour, unit } = self.preprocess;
        let unit = match unit {
            Unit::Metre => 0,
            Unit::Millimetre => 1,
        };
        let settings = [leaf_um, normal_radius_um, min_points, u32::from(colour), unit];
        let settings = settings.into_iter().flat_map(u32::to_le_bytes);
        std::iter::once(VERSION).chain(settings).chain(self.space.to_bytes()).collect()
    }

    /// Undoes [`Preparation::to_bytes`].
    ///
    /// # Errors
    /// If the bytes are none that any experiment has.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, BytesError> {
        let Some((&[VERSION, ref settings @ ..], space)) = bytes.split_first_chunk::<21>() else {
            return Err(BytesError::Settings { version: VERSION, got: bytes.len() });
        };
        let mut numbers = settings.as_chunks::<4>().0.iter().map(|number| u32::from_le_bytes(*number));
        let [leaf_um, normal_radius_um, min_points, colour, unit] =
            [(); 5].map(|()| numbers.next().unwrap_or_default());
        let space = SearchSpace::from_bytes(space)?;
        let needs_colour = matches!(&space, SearchSpace::DiskRing(table) if table.has_colour());
        let (colour, unit) = match (colour, unit) {
            (0, _) if needs_colour => return Err(BytesError::Colour),
            (colour @ (0 | 1), 0) => (colour == 1, Unit::Metre),
            (colour @ (0 | 1), 1) => (colour == 1, Unit::Millimetre),
            _ => return Err(BytesError::Settings { version: VERSION, got: bytes.len() }),
        };
        Ok(Self { preprocess: Preprocess { leaf_um, normal_radius_um, min_points, colour, unit }, space })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Descriptor, FixedDescriptor, FixedKind, GeneTable, GlobalHue, Parameters};

    #[test]
    fn a_preparation_comes_back_and_altered_bytes_are_refused() {
        let colourless = Parameters { colour_bins: 0, shape_weight_ppm: 1_000_000, ..Parameters::PAPER_BEST };
        let single = |descriptor| SearchSpace::single(&descriptor).unwrap();
        let fixed = FixedDescriptor::new(FixedKind::ShotColor, 50_000).unwrap();
        for (unit, colour, space) in [
            (Unit::Metre, true, SearchSpace::DiskRing(GeneTable::paper())),
            (Unit::Millimetre, false, single(Descriptor::DiskRing(colourless))),
            (Unit::Metre, true, single(Descriptor::DiskRing(colourless))),
            (Unit::Metre, false, single(Descriptor::Fixed(fixed))),
            (Unit::Millimetre, true, single(Descriptor::GlobalHue(GlobalHue::new(16).unwrap()))),
        ] {
            let preprocess = Preprocess { unit, colour, ..Preprocess::default() };
            let preparation = Preparation { preprocess, space };
            let bytes = preparation.to_bytes();
            assert_eq!(Preparation::from_bytes(&bytes), Ok(preparation));
            for end in 0..bytes.len() {
                Preparation::from_bytes(&bytes[..end]).unwrap_err();
            }
            Preparation::from_bytes(&[&bytes[..], &[0; 12]].concat()).unwrap_err();
            for (place, value) in [(0, 2), (13, 2), (17, 2), (20, 1), (22, 9)] {
                let mut spoilt = bytes.clone();
                spoilt[place] = value;
                Preparation::from_bytes(&spoilt).unwrap_err();
            }
        }
    }

    #[test]
    fn a_search_space_with_colour_is_not_prepared_without() {
        let preprocess = Preprocess { colour: false, ..Preprocess::default() };
        let preparation = Preparation { preprocess, space: SearchSpace::DiskRing(GeneTable::paper()) };
        assert_eq!(Preparation::from_bytes(&preparation.to_bytes()), Err(BytesError::Colour));
    }
}
