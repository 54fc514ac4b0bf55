//! Cheap baselines: one histogram of colours over all points of a cloud, as the shipped structure files have them.

use descriptor::Descriptor;
use descriptor::structure::StructureFile;

/// A histogram of the colours of a whole cloud.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GlobalHistogram {
    /// Absolute chroma, 12 × 12 bins: experiments/descriptors/chroma.toml.
    Chroma,
    /// Hue × saturation, 16 × 16 bins: experiments/descriptors/hue-saturation.toml.
    HueSaturation,
}

impl GlobalHistogram {
    /// Its name on the command line and in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Chroma => "global-chroma",
            Self::HueSaturation => "global-hue-saturation",
        }
    }

    /// The descriptor.
    pub fn descriptor(self) -> Descriptor {
        let file = match self {
            Self::Chroma => {
                include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../experiments/descriptors/chroma.toml"))
            }
            Self::HueSaturation => include_str!(concat!(
                env!("CARGO_MANIFEST_DIR"),
                "/../experiments/descriptors/hue-saturation.toml"
            )),
        };
        let file: StructureFile = toml::from_str(file).expect("the shipped file is a structure file");
        Descriptor::Structure(file.structure().expect("the shipped file is a structure"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_is_one_histogram_of_a_cloud() {
        for (histogram, bins) in [(GlobalHistogram::Chroma, 144), (GlobalHistogram::HueSaturation, 256)] {
            let descriptor = histogram.descriptor();
            assert_eq!((descriptor.channels().len(), descriptor.size()), (1, bins), "{}", histogram.name());
            assert!(descriptor.needs_colour());
        }
    }
}
