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
    /// The descriptor's name, whatever the distance.
    pub name: &'static str,
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

/// The set distances that descriptors are compared by; a structure may have another of its own.
const DISTANCES: [SetDistance; 2] = [SetDistance::ChiSquared, SetDistance::L1];

/// A named descriptor under one set distance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Choice {
    /// Which descriptor.
    pub named: Named,
    /// How clouds are compared by it.
    pub distance: SetDistance,
}

impl Choice {
    /// All that there are, in the order in which they are shown.
    pub fn all() -> impl Iterator<Item = Self> {
        let of = |named| DISTANCES.into_iter().map(move |distance| Self { named, distance });
        Named::ALL.into_iter().flat_map(of)
    }

    /// The one with this label.
    pub fn labelled(label: &str) -> Option<Self> {
        Self::all().find(|choice| choice.label() == label)
    }

    /// Its label; χ², the paper's distance, goes without saying.
    pub fn label(self) -> String {
        match self.distance {
            SetDistance::ChiSquared => self.named.name().to_owned(),
            SetDistance::L1 | SetDistance::Hellinger => {
                format!("{}-{}", self.named.name(), self.distance.name())
            }
        }
    }

    /// What is compared, in a run that has ended with `evolved`.
    pub fn candidate(self, evolved: &Descriptor, radius_um: u32) -> Candidate {
        let descriptor = self.named.descriptor(evolved, radius_um);
        Candidate { label: self.label(), name: self.named.name(), descriptor, distance: self.distance }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn labels_are_unique_name_their_choice_and_can_be_names_of_files() {
        let labels: BTreeSet<String> = Choice::all().map(Choice::label).collect();
        assert_eq!(labels.len(), Named::ALL.len() * DISTANCES.len());
        assert!(labels.iter().all(|label| label.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'-')));
        for choice in Choice::all() {
            assert_eq!(Choice::labelled(&choice.label()), Some(choice));
        }
        assert_eq!(Choice::labelled("evolved-chi2"), None);
    }
}
