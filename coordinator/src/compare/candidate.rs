//! Who takes part in a comparison: descriptors with a set distance and a recogniser, each under a label.

use descriptor::recogniser::Method;
use descriptor::{Descriptor, Family, FixedDescriptor, FixedKind, SetDistance};

use super::global::GlobalHistogram;
use crate::names::is_name;

/// Label of the run's own descriptor.
pub const EVOLVED: &str = "evolved";
/// Label of the descriptor that the paper ended with.
pub const PAPER: &str = "paper";

/// Name of a point of the run's own front.
pub fn point_name(point: u32) -> String {
    format!("{POINT_PREFIX}{point}")
}

/// What names of points begin with, before their numbers.
const POINT_PREFIX: &str = "point-";

/// Refuses the name of a point of a front to any other descriptor.
///
/// # Errors
/// What is wrong with it.
pub fn check_no_point(name: &str) -> Result<(), &'static str> {
    let number = name.strip_prefix(POINT_PREFIX).unwrap_or_default();
    if !number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit()) {
        return Err("name must not be that of a point of the front");
    }
    Ok(())
}

/// The paper counts the nine values of the reference frame, which PCL gives beside the histogram.
const SHOTCOLOR_NOTE: &str = "the paper counts 1353: with the 9 values of the reference frame";

/// A descriptor under one set distance and recogniser.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    /// Unique; can be a file's name.
    pub label: String,
    /// The descriptor's name, whatever the distance.
    pub name: String,
    /// The descriptor.
    pub descriptor: Descriptor,
    /// How clouds are compared by it.
    pub distance: SetDistance,
    /// How they are named.
    pub recogniser: Method,
}

impl Candidate {
    /// What more there is to say.
    pub fn note(&self) -> Option<&'static str> {
        (self.descriptor.family() == Family::ShotColor).then_some(SHOTCOLOR_NOTE)
    }
}

/// A descriptor that whoever compares gives and names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Given {
    /// None of the names that every comparison knows; can be a file's.
    pub name: String,
    /// The descriptor.
    pub descriptor: Descriptor,
}

/// A descriptor by the name that it has in a comparison.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Named {
    /// The run's own.
    Evolved,
    /// The paper's.
    Paper,
    /// One without genes.
    Fixed(FixedKind),
    /// A cheap baseline.
    Global(GlobalHistogram),
    /// Another one, which is named by whoever gives it.
    Given(Given),
}

impl Given {
    /// A descriptor under a name.
    ///
    /// # Errors
    /// What is wrong with the name.
    pub fn new(name: &str, descriptor: Descriptor) -> Result<Self, &'static str> {
        Self::check_name(name)?;
        Ok(Self { name: name.to_owned(), descriptor })
    }

    /// Refuses a name that a label could not begin with.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn check_name(name: &str) -> Result<(), &'static str> {
        let words = SetDistance::ALL.into_iter().map(SetDistance::name).chain(Method::ALL.map(Method::name));
        let ends_like_a_label = words
            .into_iter()
            .any(|word| name.strip_suffix(word).is_some_and(|rest| rest.is_empty() || rest.ends_with('-')));
        if !is_name(name) {
            return Err("name must be 1 to 64 letters a-z, digits, - and _, beginning without -");
        }
        if Named::ALL.iter().any(|one| one.name() == name) {
            return Err(
                "name must be none of evolved, paper, pfhrgb, shotcolor, global-chroma and global-hue-saturation",
            );
        }
        if ends_like_a_label {
            return Err("name must not end in the name of a set distance or recogniser");
        }
        Ok(())
    }
}

impl Named {
    /// All that every comparison knows, in the order in which they are shown.
    pub const ALL: [Self; 6] = [
        Self::Evolved,
        Self::Paper,
        Self::Fixed(FixedKind::PfhRgb),
        Self::Fixed(FixedKind::ShotColor),
        Self::Global(GlobalHistogram::Chroma),
        Self::Global(GlobalHistogram::HueSaturation),
    ];

    /// What the winner of every run is compared with: descriptors that anybody has without a search, describe every
    /// usable cloud and take no longer than the winner.
    pub const BASELINES: [Self; 3] =
        [Self::Paper, Self::Global(GlobalHistogram::Chroma), Self::Global(GlobalHistogram::HueSaturation)];

    /// The names of all that every comparison knows.
    pub fn names() -> [&'static str; 6] {
        static ALL: [Named; 6] = Named::ALL;
        ALL.each_ref().map(Self::name)
    }

    /// Its name on the command line and in tables.
    pub fn name(&self) -> &str {
        match self {
            Self::Evolved => EVOLVED,
            Self::Paper => PAPER,
            Self::Fixed(kind) => kind.name(),
            Self::Global(histogram) => histogram.name(),
            Self::Given(given) => &given.name,
        }
    }

    /// Whether it says nothing of clouds without colours.
    pub fn needs_colour(&self) -> bool {
        match self {
            Self::Evolved => false,
            Self::Paper | Self::Fixed(_) | Self::Global(_) => true,
            Self::Given(given) => given.descriptor.needs_colour(),
        }
    }

    /// The descriptor, in a run that has ended with `evolved`.
    pub fn descriptor(&self, evolved: &Descriptor, radius_um: u32) -> Descriptor {
        match self {
            Self::Evolved => evolved.clone(),
            Self::Paper => Descriptor::default_of(Family::DiskRing),
            &Self::Fixed(kind) => Descriptor::Fixed(FixedDescriptor { kind, radius_um }),
            Self::Global(histogram) => histogram.descriptor(),
            Self::Given(given) => given.descriptor.clone(),
        }
    }

    /// Where it is shown: given ones come last.
    fn place(&self) -> usize {
        Self::ALL.iter().position(|one| one == self).unwrap_or(Self::ALL.len())
    }
}

/// What labels end with where clouds are compared by L1.
pub const L1_SUFFIX: &str = "-l1";

/// The label of what has this name, by a recogniser; the nearest cloud goes without saying.
pub fn label(name: &str, recogniser: Method) -> String {
    match recogniser {
        Method::Nearest => name.to_owned(),
        learned => format!("{name}-{}", learned.name()),
    }
}

/// The inverse of [`label`].
pub fn split_label(label: &str) -> (&str, Method) {
    let learned = [Method::Projection, Method::KernelRidge]
        .into_iter()
        .find_map(|method| Some((label.strip_suffix(method.name())?.strip_suffix('-')?, method)));
    learned.unwrap_or((label, Method::Nearest))
}

/// The set distances that descriptors are compared by; a structure may have another of its own.
const DISTANCES: [SetDistance; 2] = [SetDistance::ChiSquared, SetDistance::L1];

/// A named descriptor under one set distance and recogniser.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Choice {
    /// Which descriptor.
    pub named: Named,
    /// How clouds are compared by it.
    pub distance: SetDistance,
    /// How clouds are named.
    pub recogniser: Method,
}

impl Choice {
    /// A descriptor under each set distance and recogniser.
    pub fn of(named: &Named) -> impl Iterator<Item = Self> {
        let under =
            |distance| Method::ALL.map(|recogniser| Self { named: named.clone(), distance, recogniser });
        DISTANCES.into_iter().flat_map(under)
    }

    /// All that every comparison knows, in the order in which they are shown.
    pub fn all() -> impl Iterator<Item = Self> {
        Named::ALL.into_iter().flat_map(|named| Self::of(&named).collect::<Vec<_>>())
    }

    /// The one with this label; `given`: the descriptor, if it is not among [`Choice::all`]. `None` if there is none.
    pub fn labelled(label: &str, given: Option<Descriptor>) -> Option<Self> {
        Self::all().find(|choice| choice.label() == label).or_else(|| {
            let (compared, recogniser) = split_label(label);
            let by_l1 = compared.strip_suffix(L1_SUFFIX);
            let distance = if by_l1.is_some() { SetDistance::L1 } else { SetDistance::ChiSquared };
            let given = Given::new(by_l1.unwrap_or(compared), given?).ok()?;
            Some(Self { named: Named::Given(given), distance, recogniser })
        })
    }

    /// Its label; χ² and the nearest cloud, as the paper has them, go without saying.
    pub fn label(&self) -> String {
        let compared = match self.distance {
            SetDistance::ChiSquared | SetDistance::Hellinger => self.named.name().to_owned(),
            SetDistance::L1 => format!("{}{L1_SUFFIX}", self.named.name()),
        };
        label(&compared, self.recogniser)
    }

    /// What is compared, in a run that has ended with `evolved`.
    pub fn candidate(&self, evolved: &Descriptor, radius_um: u32) -> Candidate {
        let descriptor = self.named.descriptor(evolved, radius_um);
        let name = self.named.name().to_owned();
        let (distance, recogniser) = (self.distance, self.recogniser);
        Candidate { label: self.label(), name, descriptor, distance, recogniser }
    }

    /// What they are shown in order of.
    pub fn rank(&self) -> (usize, &str, SetDistance, Method) {
        (self.named.place(), self.named.name(), self.distance, self.recogniser)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn labels_are_unique_name_their_choice_and_can_be_names_of_files() {
        let labels: BTreeSet<String> = Choice::all().map(|choice| choice.label()).collect();
        assert_eq!(labels.len(), Named::ALL.len() * DISTANCES.len() * Method::ALL.len());
        assert!(labels.iter().all(|label| label.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'-')));
        let structure = Descriptor::default_of(Family::Structure);
        let given = Named::Given(Given::new("chroma", structure.clone()).unwrap());
        for choice in Choice::all().chain(Choice::of(&given)) {
            assert_eq!(Choice::labelled(&choice.label(), Some(structure.clone())), Some(choice));
        }
        assert_eq!(Choice::labelled("chroma", None), None);
        // What no descriptor may be called.
        let unknown =
            ["", "-l1", "../chroma", "chroma-l1-l1", "chroma-chi2", "evolved-l1-l1", "chroma-projection-l1"];
        for label in unknown.into_iter().chain(["-projection", "chroma-nearest", "a-projection-kernel-ridge"])
        {
            assert_eq!(Choice::labelled(label, Some(structure.clone())), None, "{label}");
        }
    }

    #[test]
    fn names_are_files_names_and_nobody_elses() {
        let structure = Descriptor::default_of(Family::Structure);
        let given = |name: &str| Given::new(name, structure.clone());
        for name in ["chroma", "hue-saturation", "l1-chroma", "paper2", "xl1"] {
            assert_eq!(given(name).unwrap().name, name);
        }
        let refused = ["", "-a", "a/b", "Chroma", "paper", "evolved", "chroma-l1", "chi2", "a-hellinger"];
        for name in refused.into_iter().chain(["projection", "a-kernel-ridge", "a-nearest"]) {
            given(name).unwrap_err();
        }
    }
}
