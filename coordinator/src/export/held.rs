//! Which clouds an artefact holds by content: those with the same signatures, bit for bit, under whatever name.

use std::collections::HashMap;

use artefact::DatabaseCloud;
use descriptor::{Signature, Signatures};

/// Names of clouds by what they are described as.
pub struct HeldClouds<'a>(HashMap<Vec<u32>, &'a str>);

impl<'a> HeldClouds<'a> {
    /// Those of a database, of which these are the signatures in each channel.
    pub fn new(clouds: &'a [DatabaseCloud], reference: &[Signatures]) -> Self {
        let content = |cloud: usize| -> Vec<Signature> {
            reference.iter().map(|channel| channel.signature(cloud)).collect()
        };
        let held = clouds.iter().enumerate().map(|(number, cloud)| (bits(&content(number)), &*cloud.cloud));
        Self(held.collect())
    }

    /// The name under which a cloud with these signatures is held.
    pub fn name(&self, signatures: &[Signature]) -> Option<&'a str> {
        self.0.get(&bits(signatures)).copied()
    }

    /// Adds a cloud, unless one with the same signatures is held: then this gives the name of that one.
    pub fn add(&mut self, signatures: &[Signature], name: &'a str) -> Option<&'a str> {
        let held = self.name(signatures);
        if held.is_none() {
            self.0.insert(bits(signatures), name);
        }
        held
    }
}

fn bits(signatures: &[Signature]) -> Vec<u32> {
    let values =
        signatures.iter().flat_map(|Signature { centroid, deviation }| centroid.iter().chain(deviation));
    values.map(|value| value.to_bits()).collect()
}
