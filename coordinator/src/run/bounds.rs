//! Where a winner lies at the edge of what was searched: better ones may lie beyond.

use descriptor::{Descriptor, GeneSpec, SearchSpace};

/// What of a descriptor is at a bound of its search space, for people; nothing of one that lies inside.
pub fn bounds(space: &SearchSpace, descriptor: &Descriptor) -> Vec<String> {
    match (space, descriptor) {
        (SearchSpace::Structures(space), Descriptor::Structure(structure)) => {
            let (channels, bins) = (structure.channels.len() as u32, descriptor.size() as u32);
            let shares = space.shares(structure.channels.len());
            let (slots, max_bins) = (space.slots / shares, space.max_bins / shares);
            // Members that have one channel each say nothing of whether more would help.
            let is_choice = slots > 1 && space.slots > space.members;
            let all = (channels == slots && is_choice).then(|| format!("all {channels} channels are used"));
            // Decoding takes single bins away until a structure fits.
            let is_full = 100 * u64::from(bins) >= 95 * u64::from(max_bins);
            all.into_iter().chain(is_full.then(|| format!("{bins} of at most {max_bins} bins"))).collect()
        }
        _ => {
            let values = descriptor.family().columns().into_iter().zip(descriptor.values());
            let value = |spec: &GeneSpec| values.clone().find(|(column, _)| column.name == spec.name)?.1;
            let genes = space.genes().into_iter().filter(|(_, domain)| domain.count > 1);
            let found = genes.filter_map(|(spec, domain)| {
                let value = value(spec)?;
                let (side, edge) = if value == spec.value(domain.low) {
                    ("least", domain.low == spec.limits.0)
                } else if value == spec.value(domain.high()) {
                    ("greatest", domain.high() == spec.limits.1)
                } else {
                    return None;
                };
                let of = if edge { "there can be" } else { "of its interval" };
                let unit = if spec.unit.is_empty() { String::new() } else { format!(" {}", spec.unit) };
                Some(format!("{} = {value}{unit}, the {side} {of}", spec.name))
            });
            found.collect()
        }
    }
}

#[cfg(test)]
mod tests {
    use descriptor::{Domain, Family};

    use super::*;

    #[test]
    fn genes_at_the_ends_of_their_intervals_are_named() {
        // In ticks: R1 and R2 in micrometres, w in millionths.
        let domains = [(20, 1, 9), (4, 1, 3), (5000, 1000, 6), (30_000, 1000, 9), (0, 100_000, 8)];
        let domains = domains.map(|(low, step, count)| Domain { low, step, count });
        let space = SearchSpace::new(Family::DiskRing, true, &domains).unwrap();
        let of = |values: [f64; 5]| {
            let descriptor = space.from_values(&values.map(Some)).unwrap();
            bounds(&space, &descriptor)
        };
        assert_eq!(of([24.0, 5.0, 0.7, 3.3, 0.3]), Vec::<String>::new());
        assert_eq!(
            of([20.0, 6.0, 1.0, 3.0, 0.0]),
            [
                "shape_bins = 20, the least of its interval",
                "m = 6, the greatest of its interval",
                "R1 = 1 cm, the greatest of its interval",
                "R2 = 3 cm, the least of its interval",
                "w = 0, the least there can be",
            ]
        );
        // A gene that is fixed has no bounds.
        let fixed = domains.map(|domain| Domain { count: 1, ..domain });
        let single = SearchSpace::new(Family::DiskRing, true, &fixed).unwrap();
        let only = single.from_values(&[20.0, 4.0, 0.5, 3.0, 0.0].map(Some)).unwrap();
        assert_eq!(bounds(&single, &only), Vec::<String>::new());
    }
}
