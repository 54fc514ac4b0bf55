//! Small clouds for tests, from integers and arithmetic only, so that every target makes the same bits.

use rand::{Rng, RngExt};

use crate::disk_ring::weighted;
use crate::random::stream;
use crate::signature::{Signature, Signatures};
use crate::{Cloud, GeneTable, Parameters};

/// A number in [0, 1) that f32 holds exactly.
pub(crate) fn unit(rng: &mut impl Rng) -> f32 {
    (rng.random::<u32>() >> 8) as f32 / 16_777_216.0
}

/// The descriptor of the paper's space that a chromosome of 25 bits stands for (DESIGN 5.8).
pub(crate) fn of_bits(bits: &[bool]) -> Parameters {
    let table = GeneTable::paper();
    let mut rest = bits.iter();
    let indices = table.genes().map(|(_, domain)| {
        let width = domain.count.next_power_of_two().trailing_zeros();
        let code = rest.by_ref().take(width as usize).fold(0, |code, &bit| code << 1 | u32::from(bit));
        (code * domain.count) >> width
    });
    table.at(&indices.collect::<Vec<_>>()).expect("every bit string is valid")
}

/// A point in the cube [0, side)³.
pub(crate) fn in_cube(rng: &mut impl Rng, side: f32) -> [f32; 3] {
    [unit(rng) * side, unit(rng) * side, unit(rng) * side]
}

/// A bent, rough, coloured sheet of about 12 × 12 cm, 60 cm before the camera, some points of it repeated.
pub(crate) fn sheet(seed: u64, points: usize) -> Cloud {
    let mut rng = stream(seed, "test sheet", &[]);
    let bend = unit(&mut rng) * 8.0;
    let mut cloud = Cloud { colours: Some(Vec::new()), viewpoint: [0.01, -0.02, 0.0], ..Cloud::default() };
    let mut colours = Vec::new();
    for index in 0..points {
        let (u, v) = (unit(&mut rng) * 0.12 - 0.06, unit(&mut rng) * 0.12 - 0.06);
        let point = if index % 17 == 16 {
            cloud.points[index / 2]
        } else {
            [u, v, 0.6 + bend * (u * u - 0.5 * u * v) + 0.0008 * unit(&mut rng)]
        };
        cloud.points.push(point);
        let hue = if u * v > 0.0 { [200u8, 60, 30] } else { [40, 90, 180] };
        colours.push(hue.map(|channel| channel + (rng.random::<u32>() % 50) as u8));
    }
    cloud.colours = Some(colours);
    cloud
}

/// Clouds in shape and in colour, channel by channel.
pub(crate) fn by_channel(clouds: &[[Signature; 2]]) -> [Signatures; 2] {
    [0, 1].map(|channel| clouds.iter().map(|cloud| &cloud[channel]).collect())
}

/// Set distance of two clouds in shape and in colour, by the paper's formula.
pub(crate) fn set_distance(a: &[Signature; 2], b: &[Signature; 2], shape_weight: f64) -> f64 {
    weighted(a[0].distance(&b[0]), a[1].distance(&b[1]), shape_weight)
}
