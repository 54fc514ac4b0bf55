//! Who takes part in a comparison: descriptors with a set distance, each under a label.

use descriptor::{Descriptor, Family, FixedDescriptor, FixedKind, SetDistance};

/// Label of the run's own descriptor.
pub const EVOLVED: &str = "evolved";
/// Label of the descriptor that the paper ended with.
pub const PAPER: &str = "paper";

/// The paper counts the nine values of the reference frame, which PCL gives beside the histogram.
const SHOTCOLOR_NOTE: &str = "the paper counts 1353: with the 9 values of the reference frame";

/// A descriptor under one set distance.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    /// Unique; can be a file's name.
    pub label: String,
    /// The descriptor.
    pub descriptor: Descriptor,
    /// How clouds are compared by it.
    pub distance: SetDistance,
}

impl Candidate {
    /// What more there is to say.
    pub fn note(&self) -> Option<&'static str> {
        (self.descriptor.family() == Family::ShotColor).then_some(SHOTCOLOR_NOTE)
    }
}

/// A descriptor that can be asked for by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Named {
    /// The run's own.
    Evolved,
    /// The paper's.
    Paper,
    /// One without genes.
    Fixed(FixedKind),
}

impl Named {
    /// All of them, in the order in which they are shown.
    pub const ALL: [Self; 4] =
        [Self::Evolved, Self::Paper, Self::Fixed(FixedKind::PfhRgb), Self::Fixed(FixedKind::ShotColor)];

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Evolved => EVOLVED,
            Self::Paper => PAPER,
            Self::Fixed(kind) => kind.name(),
        }
    }

    /// Whether it says nothing of clouds without colours.
    pub fn needs_colour(self) -> bool {
        self != Self::Evolved
    }

    /// The descriptor, in a run that has ended with `evolved`.
    pub fn descriptor(self, evolved: &Descriptor, radius_um: u32) -> Descriptor {
        match self {
            Self::Evolved => evolved.clone(),
            Self::Paper => Descriptor::default_of(Family::DiskRing),
            Self::Fixed(kind) => Descriptor::Fixed(FixedDescriptor { kind, radius_um }),
        }
    }
}

/// Every descriptor under every set distance; χ², the paper's, goes without saying.
pub fn candidates(
    named: &[Named],
    distances: &[SetDistance],
    evolved: &Descriptor,
    radius_um: u32,
) -> Vec<Candidate> {
    let of = |&named: &Named| {
        distances.iter().map(move |&distance| Candidate {
            label: match distance {
                SetDistance::ChiSquared => named.name().to_owned(),
                SetDistance::L1 => format!("{}-{}", named.name(), distance.name()),
            },
            descriptor: named.descriptor(evolved, radius_um),
            distance,
        })
    };
    named.iter().flat_map(of).collect()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn labels_are_unique_and_can_be_names_of_files() {
        let all =
            candidates(&Named::ALL, &SetDistance::ALL, &Descriptor::default_of(Family::DiskRing), 50_000);
        let labels: BTreeSet<&str> = all.iter().map(|one| one.label.as_str()).collect();
        assert_eq!(labels.len(), Named::ALL.len() * SetDistance::ALL.len());
        assert!(labels.iter().all(|label| label.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'-')));
    }
}
