//! How far apart the points of a cloud are, and what that says of its unit.

use std::fmt;
use std::ops::RangeInclusive;

use crate::{Cloud, Preprocess, Unit};

/// Distances computed for the spacing of one cloud, at most.
const DISTANCES: usize = 5_000_000;
/// Points of a cloud whose nearest neighbour is looked for, at most.
const POINTS: usize = 200;
/// Plausible medians, metres. Depth cameras see household objects at 0.5 to 10 mm, desktop scanners down to
/// 0.1 mm; beyond these bounds the unit is wrong, or no neighbourhood of some centimetres has points.
pub const PLAUSIBLE_SPACING: RangeInclusive<f64> = 0.000_05..=0.05;
/// Below this median, metres, clouds of a plausible other unit are refused: a scanner with points 0.02 mm apart, taken
/// for one in metres, would have them 2 cm apart, which is no longer clearly absurd.
const LEAST_SPACING: f64 = 0.000_02;
/// Longest edges of objects and scenes, metres, that are no reason to look at a cloud's spacing.
const USUAL_EXTENT: RangeInclusive<f64> = 0.05..=10.0;

/// Points that are as far apart as in no cloud of the declared unit, and would be plausible in the other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WrongUnit {
    /// Median distance from a point to its nearest neighbour, metres, if the unit were right.
    pub spacing: f64,
    /// The least and the largest that are taken, metres.
    pub expected: [f64; 2],
    /// The declared unit.
    pub unit: Unit,
    /// The one that the clouds are probably in.
    pub other: Unit,
}

impl WrongUnit {
    /// The spacing and what was expected in millimetres, to two digits.
    pub fn millimetres(&self) -> (f64, [f64; 2]) {
        (millimetres(self.spacing), self.expected.map(millimetres))
    }
}

impl fmt::Display for WrongUnit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (spacing, [least, most]) = self.millimetres();
        let Self { unit, other, .. } = self;
        write!(
            f,
            "points {least} to {most} mm apart expected, got {spacing} mm, as if {other} were read as {unit}"
        )
    }
}

/// A length in metres as millimetres to two significant digits, for people.
pub fn millimetres(metres: f64) -> f64 {
    let millimetres = metres * 1000.0;
    format!("{millimetres:.1e}").parse().unwrap_or(millimetres)
}

/// Median, over points spread through a cloud in metres, of the distance to the nearest other position, the lower of two;
/// `None` if there are no two points apart.
pub fn median_spacing(points: &[[f32; 3]]) -> Option<f64> {
    let wanted = POINTS.min((DISTANCES / points.len().max(1)).max(1));
    let every = points.len().div_ceil(wanted).max(1);
    let nearest = |point: &[f32; 3]| {
        let squared = points.iter().map(|other| {
            let [x, y, z] = [0, 1, 2].map(|axis| f64::from(point[axis]) - f64::from(other[axis]));
            x * x + y * y + z * z
        });
        squared.filter(|&d2| d2 > 0.0).min_by(f64::total_cmp).map(f64::sqrt)
    };
    let mut nearest: Vec<f64> = points.iter().step_by(every).filter_map(nearest).collect();
    nearest.sort_by(f64::total_cmp);
    nearest.get(nearest.len().saturating_sub(1) / 2).copied()
}

/// Refuses clouds of another unit than the one that is declared where their spacing, in metres, says so: it is that of no
/// sensor, and would be that of one in the other unit. Normals over a larger radius than usual go with sparser clouds.
///
/// # Errors
/// [`WrongUnit`].
pub fn check_spacing(spacing: f64, preprocess: &Preprocess) -> Result<(), WrongUnit> {
    let most = PLAUSIBLE_SPACING.end().max(preprocess.normal_radius());
    let (unit, other) = (preprocess.unit, preprocess.unit.other());
    if (LEAST_SPACING..=most).contains(&spacing) || !PLAUSIBLE_SPACING.contains(&unit.in_other(spacing)) {
        return Ok(());
    }
    Err(WrongUnit { spacing, expected: [LEAST_SPACING, most], unit, other })
}

/// The same of one cloud in metres. Spacing is measured only of clouds that are no usual size: of others the unit is right,
/// and looking costs little.
///
/// # Errors
/// [`WrongUnit`].
pub fn check_unit(cloud: &Cloud, preprocess: &Preprocess) -> Result<(), WrongUnit> {
    if extent(&cloud.points).is_none_or(|extent| USUAL_EXTENT.contains(&extent)) {
        return Ok(());
    }
    median_spacing(&cloud.points).map_or(Ok(()), |spacing| check_spacing(spacing, preprocess))
}

/// The longest edge of the box about the points.
fn extent(points: &[[f32; 3]]) -> Option<f64> {
    let first = *points.first()?;
    let (low, high) = points.iter().fold((first, first), |(low, high), point| {
        let axes = [0, 1, 2];
        (axes.map(|axis| low[axis].min(point[axis])), axes.map(|axis| high[axis].max(point[axis])))
    });
    let edges = [0, 1, 2].map(|axis| f64::from(high[axis]) - f64::from(low[axis]));
    edges.into_iter().max_by(f64::total_cmp)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of so many points along an edge, `apart` metres from each other.
    fn square(edge: u16, apart: f32) -> Cloud {
        let place = |number: u16| [f32::from(number % edge) * apart, f32::from(number / edge) * apart, 1.0];
        Cloud { points: (0..edge * edge).map(place).collect(), colours: None, viewpoint: [0.0; 3] }
    }

    fn of(unit: Unit) -> Preprocess {
        Preprocess { unit, ..Preprocess::default() }
    }

    #[test]
    fn the_median_is_that_of_the_distances_to_the_nearest_point() {
        assert!((median_spacing(&square(12, 0.002).points).unwrap() - 0.002).abs() < 1e-8);
        // Equal positions are no neighbours.
        let twice = [square(12, 0.002).points, square(12, 0.002).points].concat();
        assert!((median_spacing(&twice).unwrap() - 0.002).abs() < 1e-8);
        assert_eq!(median_spacing(&[[1.0; 3]; 5]), None);
        assert_eq!(median_spacing(&[]), None);
    }

    #[test]
    fn a_cloud_of_the_other_unit_is_refused_and_others_are_not() {
        // 10 cm with points 2 mm apart, as millimetres read as metres and as metres read as millimetres.
        let object = square(50, 0.002);
        assert_eq!([Unit::Metre, Unit::Millimetre].map(|unit| check_unit(&object, &of(unit))), [Ok(()); 2]);
        let thousandfold = check_unit(&square(50, 2.0), &of(Unit::Metre)).unwrap_err();
        assert_eq!((thousandfold.unit, thousandfold.other), (Unit::Metre, Unit::Millimetre));
        assert_eq!(
            thousandfold.to_string(),
            "points 0.02 to 50 mm apart expected, got 2000 mm, as if mm were read as m"
        );
        let thousandth = check_unit(&square(50, 0.000_002), &of(Unit::Millimetre)).unwrap_err();
        assert_eq!((thousandth.unit, thousandth.other), (Unit::Millimetre, Unit::Metre));
        // Too far apart, or too near, for the other unit as well.
        assert_eq!(check_unit(&square(50, 200.0), &of(Unit::Metre)), Ok(()));
        assert_eq!(check_unit(&square(50, 0.000_002), &of(Unit::Metre)), Ok(()));
        // A hall, and a ring.
        assert!(check_unit(&square(100, 0.2), &of(Unit::Metre)).is_err());
        assert_eq!(check_unit(&square(200, 0.04), &of(Unit::Metre)), Ok(()));
        assert_eq!(check_unit(&square(20, 0.001), &of(Unit::Metre)), Ok(()));
        // Sparse clouds go with a large radius of normals.
        let sparse = Preprocess { normal_radius_um: 500_000, ..of(Unit::Metre) };
        assert_eq!(check_unit(&square(100, 0.2), &sparse), Ok(()));
        assert_eq!(check_unit(&Cloud { points: Vec::new(), ..object }, &of(Unit::Metre)), Ok(()));
    }
}
