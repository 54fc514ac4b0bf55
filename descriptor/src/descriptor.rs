//! A descriptor of any family: to everything outside this crate a value with bytes, a name, columns and a cost.

use std::borrow::{Borrow, Cow};
use std::fmt;

use crate::bytes::{self, BytesError, Reader};
use crate::channel::Channel;
use crate::cost;
use crate::disk_ring::{GeneKind, Parameters};
use crate::distance::{DistanceMatrix, SetDistance};
use crate::family::Family;
use crate::fixed::{FixedDescriptor, FixedKind};
use crate::global_hue::GlobalHue;
use crate::pruning::PrunedDatabase;
use crate::recognise::{Label, RecogniseError};
use crate::signature::Signatures;
use crate::signature_bytes::{Columns, Layout, SignatureError};
use crate::structure::{Scale, Structure, Weighted, scale_among};

/// Clouds of the database among which [`Descriptor::recognition_cost`] counts a cloud to be recognised.
pub const COST_DATABASE: u64 = 1000;

/// A descriptor of any family.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Descriptor {
    /// The paper's.
    DiskRing(Parameters),
    /// One without genes.
    Fixed(FixedDescriptor),
    /// A histogram of hue.
    GlobalHue(GlobalHue),
    /// Some channels.
    Structure(Structure),
}

impl Descriptor {
    /// Its family.
    pub fn family(&self) -> Family {
        match self {
            Self::DiskRing(_) => Family::DiskRing,
            Self::Fixed(fixed) => fixed.kind.into(),
            Self::GlobalHue(_) => Family::GlobalHue,
            Self::Structure(_) => Family::Structure,
        }
    }

    /// Its parameters, for people.
    pub fn parameters(&self) -> String {
        match self {
            Self::DiskRing(parameters) => parameters.to_string(),
            Self::Fixed(fixed) => format!("radius={} cm", fixed.radius_cm()),
            Self::GlobalHue(hue) => format!("bins={}", hue.bins()),
            Self::Structure(structure) => structure.to_string(),
        }
    }

    /// The one of a family that is computed unless values are given: of disk-ring the paper's best.
    pub fn default_of(family: Family) -> Self {
        let fixed =
            |kind| Self::Fixed(FixedDescriptor { kind, radius_um: FixedDescriptor::DEFAULT_RADIUS_UM });
        match family {
            Family::DiskRing => Self::DiskRing(Parameters::PAPER_BEST),
            Family::PfhRgb => fixed(FixedKind::PfhRgb),
            Family::ShotColor => fixed(FixedKind::ShotColor),
            Family::GlobalHue => Self::GlobalHue(GlobalHue::default()),
            Family::Structure => Self::Structure(Structure::default()),
        }
    }

    /// What it has in the columns of its family ([`Family::columns`]), those of a structure of at least four slots; `None`
    /// for a gene that it is without.
    pub fn values(&self) -> Vec<Option<f64>> {
        match self {
            Self::DiskRing(parameters) => {
                let is_there = |kind| kind != GeneKind::ColourBins || parameters.has_colour();
                GeneKind::ALL.map(|kind| is_there(kind).then(|| parameters.value(kind))).to_vec()
            }
            Self::Fixed(fixed) => vec![Some(fixed.radius_cm())],
            Self::GlobalHue(hue) => vec![Some(f64::from(hue.bins()))],
            Self::Structure(structure) => structure.values_of_slots(structure.channels.len()),
        }
    }

    /// Undoes [`Descriptor::values`]; `None` if the family has no such descriptor.
    pub fn from_values(family: Family, values: &[Option<f64>]) -> Option<Self> {
        match family {
            Family::DiskRing => {
                let parameters = Parameters::from_values(values)?;
                parameters.check().is_ok().then_some(Self::DiskRing(parameters))
            }
            Family::PfhRgb | Family::ShotColor => {
                let &[Some(radius_cm)] = values else { return None };
                FixedDescriptor::from_value(family.fixed_kind()?, radius_cm).map(Self::Fixed)
            }
            Family::GlobalHue => {
                let &[Some(bins)] = values else { return None };
                GlobalHue::new(GlobalHue::GENE.ticks(bins)?).ok().map(Self::GlobalHue)
            }
            Family::Structure => Structure::from_values(values, SetDistance::default()).map(Self::Structure),
        }
    }

    /// Values of one keypoint's descriptor; of channels without keypoints, of the cloud's.
    pub fn size(&self) -> usize {
        match self {
            Self::DiskRing(parameters) => parameters.size(),
            Self::Fixed(fixed) => fixed.kind.size(),
            Self::GlobalHue(hue) => hue.bins() as usize,
            Self::Structure(structure) => structure.bins() as usize,
        }
    }

    /// Whether it is nothing without colours.
    pub fn needs_colour(&self) -> bool {
        match self {
            Self::DiskRing(parameters) => parameters.has_colour(),
            Self::Fixed(_) | Self::GlobalHue(_) => true,
            Self::Structure(Structure { channels }) => channels.iter().any(|one| one.channel.needs_colour()),
        }
    }

    /// Values that are kept of a cloud.
    pub fn size_of_cloud(&self) -> u64 {
        self.layout().values()
    }

    /// Its channels with their weights, in the order in which distances are added up.
    pub fn channels(&self) -> Vec<(Channel, f64)> {
        match self {
            Self::DiskRing(parameters) => {
                let [shape, colour] = Channel::disk_ring(parameters);
                let weight = parameters.shape_weight();
                vec![(shape, weight), (colour, 1.0 - weight)]
            }
            Self::Fixed(fixed) => vec![(Channel::fixed(*fixed), 1.0)],
            Self::GlobalHue(hue) => vec![(Channel::global_hue(*hue), 1.0)],
            Self::Structure(Structure { channels }) => {
                let weighted = |one: &Weighted| (Channel::structure(one.channel.clone()), one.weight());
                channels.iter().map(weighted).collect()
            }
        }
    }

    /// The structure of one channel alone, without a scale; `None` of other families, whose descriptors all have the same
    /// channels.
    pub fn of_channel(channel: &Channel) -> Option<Self> {
        let channel = channel.as_structure()?.clone();
        let alone = Weighted { channel, weight_ppm: Weighted::UNIT_PPM, scale: Scale::None };
        Some(Self::Structure(Structure { channels: vec![alone] }))
    }

    /// For each channel the descriptor of this channel alone if its distances are divided by a scale, which is found by
    /// it; `None` where they are taken as they are.
    pub fn scaled_channels(&self) -> Vec<Option<Self>> {
        match self {
            Self::Structure(Structure { channels }) => {
                let alone = |one: &Weighted| match one.scale {
                    Scale::Quantile => Self::of_channel(&Channel::structure(one.channel.clone())),
                    Scale::None => None,
                };
                channels.iter().map(alone).collect()
            }
            _ => vec![None; self.channels().len()],
        }
    }

    /// Distances of all queries to all clouds of a database in each channel, by a set distance or, of a structure if
    /// that is χ², by the channel's own; each with the factor of its distances: weight over scale. Scales are those of
    /// [`Descriptor::scales`]. Signatures are those of queries and database in each channel.
    ///
    /// # Panics
    /// If there are not as many as channels: a programming error.
    pub fn distances(
        &self,
        distance: SetDistance,
        signatures: &[[Signatures; 2]],
        known: usize,
    ) -> Vec<(DistanceMatrix, f64)> {
        let databases: Vec<&Signatures> = signatures.iter().map(|[_, database]| database).collect();
        let scales = self.scales(distance, &databases, known);
        let channels = self.channels().into_iter().zip(scales).zip(signatures);
        channels
            .map(|(((channel, weight), scale), [queries, database])| {
                (DistanceMatrix::by(channel.metric_or(distance), queries, database), weight / scale)
            })
            .collect()
    }

    /// A database in each channel, compared as in [`Descriptor::distances`], with bounds: what takes its place where the
    /// distances would take too much memory.
    ///
    /// # Errors
    /// [`RecogniseError::EmptyDatabase`] if there is no cloud.
    ///
    /// # Panics
    /// If there are not as many signatures as channels, or not one label for each cloud: a programming error.
    pub fn pruned<'a>(
        &self,
        distance: SetDistance,
        database: &[&'a Signatures],
        labels: &[Label],
        known: usize,
    ) -> Result<PrunedDatabase<'a>, RecogniseError> {
        let scales = self.scales(distance, database, known);
        let channels = self.channels().into_iter().zip(scales).zip(database).map(
            |(((channel, weight), scale), &database)| {
                (Cow::Borrowed(database), channel.metric_or(distance), weight / scale)
            },
        );
        PrunedDatabase::new(channels.collect(), labels)
    }

    /// What distances by this set distance, or by a channel's own as in [`Descriptor::distances`], are divided by in each
    /// channel: the [`scale_among`] of the first clouds of a database, so many as `known` says, or 1 where they are taken as they
    /// are. Signatures are those of the database in each channel.
    ///
    /// # Panics
    /// If there are not as many as channels: a programming error.
    pub fn scales<S: Borrow<Signatures>>(
        &self,
        distance: SetDistance,
        database: &[S],
        known: usize,
    ) -> Vec<f64> {
        let channels = self.channels();
        assert_eq!(database.len(), channels.len(), "signatures in each channel");
        let channels = channels.into_iter().zip(self.scaled_channels()).zip(database);
        channels
            .map(|(((channel, _), scaled), database)| {
                scaled.map_or(1.0, |_| {
                    scale_among(channel.metric_or(distance), &database.borrow().first(known))
                })
            })
            .collect()
    }

    /// The counted cost of describing so many clouds and matching so many pairs of clouds: see [`cost`].
    pub fn cost(&self, clouds: u64, pairs: u64) -> u64 {
        let describing = match self {
            Self::DiskRing(parameters) => cost::disk_ring(parameters, self.size_of_cloud() / 2),
            Self::Fixed(fixed) => cost::fixed(fixed),
            Self::GlobalHue(_) => cost::global_hue(),
            Self::Structure(structure) => cost::structure(structure),
        };
        cost::total(describing, clouds, self.size_of_cloud(), pairs)
    }

    /// The counted cost of recognising one cloud among [`COST_DATABASE`] others.
    pub fn recognition_cost(&self) -> u64 {
        self.cost(1, COST_DATABASE)
    }

    /// Canonical bytes: tag of the family, version, numbers. Equal for equal descriptors only.
    pub fn to_bytes(&self) -> Vec<u8> {
        match self {
            Self::DiskRing(parameters) => bytes::write(self.family(), parameters.all_ticks()),
            Self::Fixed(fixed) => bytes::write(self.family(), [fixed.radius_um]),
            Self::GlobalHue(hue) => bytes::write(self.family(), [hue.bins()]),
            Self::Structure(structure) => bytes::write(self.family(), structure.numbers()),
        }
    }

    /// Undoes [`Descriptor::to_bytes`].
    ///
    /// # Errors
    /// If the bytes are no descriptor that any experiment may use.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, BytesError> {
        let reader = Reader::new("descriptor", bytes)?;
        match reader.family {
            Family::DiskRing => {
                let parameters = Parameters::from_ticks(reader.numbers()?);
                parameters.check().map_err(|what| reader.refuse(what))?;
                Ok(Self::DiskRing(parameters))
            }
            Family::PfhRgb | Family::ShotColor => read_fixed(&reader).map(Self::Fixed),
            Family::GlobalHue => {
                let [bins] = reader.numbers()?;
                GlobalHue::new(bins).map(Self::GlobalHue).map_err(|error| reader.refuse(error.to_string()))
            }
            Family::Structure => Structure::from_numbers(&reader.all_numbers()?)
                .map(Self::Structure)
                .map_err(|error| reader.refuse(error.to_string())),
        }
    }

    fn layout(&self) -> Layout {
        match self {
            Self::DiskRing(parameters) => {
                let channels = parameters.channel_bins().map(|bins| [bins, bins]).to_vec();
                Layout { channels, tells_keypoints: false, largest: 1, tolerance: 0.0 }
            }
            Self::Fixed(fixed) => {
                let channels = vec![[fixed.kind.size() as u64; 2]];
                Layout { channels, tells_keypoints: true, largest: fixed.kind.largest(), tolerance: 1e-3 }
            }
            Self::GlobalHue(hue) => {
                let channels = vec![[u64::from(hue.bins()), 0]];
                Layout { channels, tells_keypoints: false, largest: 1, tolerance: 0.0 }
            }
            Self::Structure(Structure { channels }) => {
                let channels = channels.iter().map(|one| one.channel.lengths()).collect();
                Layout { channels, tells_keypoints: false, largest: 1, tolerance: 0.0 }
            }
        }
    }

    /// Length of the encoded signatures of so many clouds, bytes.
    pub fn signature_bytes(&self, clouds: u32) -> u64 {
        self.layout().length(clouds)
    }

    /// The signatures of the same clouds in each channel as bytes (see [`crate::signature_bytes`]).
    pub fn encode_signatures<S: Borrow<Signatures>>(&self, channels: &[S]) -> Vec<u8> {
        Layout::encode(channels.iter().map(Borrow::borrow))
    }

    /// Refuses bytes that cannot be the signatures of so many clouds.
    ///
    /// # Errors
    /// If they cannot.
    pub fn check_signatures(&self, bytes: &[u8], clouds: u32) -> Result<(), SignatureError> {
        self.layout().check(bytes, clouds)
    }

    /// Undoes [`Descriptor::encode_signatures`]: one a channel. Whatever the bytes are, distances between the
    /// signatures are finite.
    ///
    /// # Errors
    /// If the bytes cannot be the signatures of so many clouds.
    pub fn decode_signatures(&self, bytes: &[u8], clouds: u32) -> Result<Vec<Signatures>, SignatureError> {
        self.layout().decode(bytes, clouds)
    }

    /// Signatures of so many clouds from centroids and deviations that were kept as columns, channel by channel.
    ///
    /// # Errors
    /// If the columns cannot be those of so many clouds.
    pub fn signatures_of_columns(
        &self,
        channels: &[Columns<'_>],
        clouds: u32,
    ) -> Result<Vec<Signatures>, SignatureError> {
        self.layout().of_columns(channels, clouds)
    }
}

/// The descriptor without genes, or the space of it alone, that a reader has come upon.
pub(crate) fn read_fixed(reader: &Reader<'_>) -> Result<FixedDescriptor, BytesError> {
    let kind = reader.family.fixed_kind().ok_or_else(|| reader.refuse("a family with genes"))?;
    let [radius_um] = reader.numbers()?;
    FixedDescriptor::new(kind, radius_um).map_err(|what| reader.refuse(what))
}

impl fmt::Display for Descriptor {
    /// Its parameters; of a histogram of hue and of descriptors without genes, after the name of their family.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::DiskRing(parameters) => parameters.fmt(f),
            Self::Structure(structure) => structure.fmt(f),
            Self::Fixed(_) | Self::GlobalHue(_) => write!(f, "{} {}", self.family(), self.parameters()),
        }
    }
}
