//! What the distances of a structure's channels are divided by: found when an artefact is made, checked when it is
//! opened.

use descriptor::{Descriptor, Family, SetDistance, Signatures};
use proto::task::is_scale;

/// The scale of each channel, found by the first clouds of a database, so many as `known` says; `None` in families
/// without scales.
pub fn found(descriptor: &Descriptor, database: &[Signatures], known: usize) -> Option<Vec<f64>> {
    has_scales(descriptor).then(|| descriptor.scales(SetDistance::ChiSquared, database, known))
}

/// What each channel's distances are multiplied by, in the order of the channels: weight over scale.
pub fn weights(descriptor: &Descriptor, scales: Option<&[f64]>) -> Vec<f64> {
    let scales = scales.into_iter().flatten().copied().chain(std::iter::repeat(1.0));
    descriptor.channels().into_iter().zip(scales).map(|((_, weight), scale)| weight / scale).collect()
}

/// Refuses scales that a descriptor cannot have; `Err` says what was found instead.
pub fn check(descriptor: &Descriptor, scales: Option<&[f64]>) -> Result<(), String> {
    let Some(scales) = scales else {
        return if has_scales(descriptor) { Err("no database.scales".to_owned()) } else { Ok(()) };
    };
    if !has_scales(descriptor) {
        return Err(format!("database.scales beside family {}", descriptor.family()));
    }
    let channels = descriptor.scaled_channels();
    if scales.len() != channels.len() {
        let (channels, got) = (channels.len(), scales.len());
        return Err(format!("database.scales of {got} channels where the descriptor has {channels}"));
    }
    for ((number, scaled), &scale) in (1..).zip(channels).zip(scales) {
        if !is_scale(scale) {
            return Err(format!(
                "database.scales with {scale} for channel {number} instead of a distance above 0"
            ));
        }
        if scaled.is_none() && scale != 1.0 {
            return Err(format!("database.scales with {scale} for channel {number}, which is unscaled: 1"));
        }
    }
    Ok(())
}

fn has_scales(descriptor: &Descriptor) -> bool {
    descriptor.family() == Family::Structure
}

#[cfg(test)]
mod tests {
    use descriptor::Signature;
    use descriptor::structure::{Scale, Structure};

    use super::*;

    /// Two channels, of which the second is unscaled.
    fn structure() -> Descriptor {
        let mut structure = Structure::default();
        structure.channels[1].scale = Scale::None;
        Descriptor::Structure(structure)
    }

    #[test]
    fn scales_are_those_of_the_first_clouds_and_1_where_a_channel_has_none() {
        let cloud = |value: f32| Signature { centroid: vec![value, 1.0 - value], deviation: Vec::new() };
        let clouds: Vec<Signature> = [0.0, 0.25, 1.0, 1.0, 1.0].map(cloud).to_vec();
        let channel: Signatures = clouds.iter().collect();
        let database = [channel.clone(), channel];
        let nearest = f64::from(clouds[0].distance(&clouds[1]));
        assert_eq!(found(&structure(), &database, 3), Some(vec![nearest, 1.0]));
        assert_eq!(found(&structure(), &database, 5), Some(vec![1.0, 1.0]), "three of the same are 0 apart");
        let disk_ring = Descriptor::default_of(Family::DiskRing);
        assert_eq!(found(&disk_ring, &database, 3), None);
        assert_eq!(weights(&structure(), Some(&[0.25, 1.0])), [4.0, 1.0]);
        assert_eq!(weights(&disk_ring, None), disk_ring.channels().iter().map(|it| it.1).collect::<Vec<_>>());
    }

    #[test]
    fn scales_that_no_channel_has_are_refused() {
        let cases: [(Option<&[f64]>, &str); 11] = [
            (None, "no database.scales"),
            (Some(&[]), "of 0 channels where the descriptor has 2"),
            (Some(&[0.5]), "of 1 channels where the descriptor has 2"),
            (Some(&[0.5, 1.0, 1.0]), "of 3 channels where the descriptor has 2"),
            (Some(&[0.0, 1.0]), "with 0 for channel 1"),
            (Some(&[-0.5, 1.0]), "with -0.5 for channel 1"),
            (Some(&[f64::NAN, 1.0]), "with NaN for channel 1"),
            (Some(&[f64::INFINITY, 1.0]), "with inf for channel 1"),
            (Some(&[1e-300, 1.0]), "for channel 1 instead of a distance"),
            (Some(&[1e300, 1.0]), "for channel 1 instead of a distance"),
            (Some(&[0.5, 0.5]), "with 0.5 for channel 2, which is unscaled"),
        ];
        for (scales, complaint) in cases {
            let said = check(&structure(), scales).unwrap_err();
            assert!(said.contains(complaint), "{scales:?}: {said}");
        }
        check(&structure(), Some(&[0.5, 1.0])).unwrap();
        let disk_ring = Descriptor::default_of(Family::DiskRing);
        check(&disk_ring, None).unwrap();
        let said = check(&disk_ring, Some(&[0.5, 1.0])).unwrap_err();
        assert_eq!(said, "database.scales beside family disk-ring");
    }
}
