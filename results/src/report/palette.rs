//! Colours of figures, on paper and, by CSS variables, on pages that are light or dark.

use std::fmt::Write as _;

/// Red, green and blue.
pub(crate) type Rgb = [u8; 3];

/// Text and axes.
pub(crate) const INK: Rgb = [0x1a; 3];
/// Lines behind the marks.
pub(crate) const GRID: Rgb = [0xe4; 3];
/// The paper.
pub(crate) const PAPER: Rgb = [0xff; 3];
/// Shades from the lightest to the darkest: so few that a page has a class for each.
const SHADES: u32 = 32;

/// The palette of Okabe and Ito (Color universal design, 2008), which people who confuse red and green can tell apart,
/// without its yellow, which is too faint for lines on white.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Colour {
    Blue,
    Vermillion,
    Green,
    Orange,
    Sky,
    Purple,
    Black,
    Grey,
}

impl Colour {
    const ALL: [Self; 8] = [
        Self::Blue,
        Self::Vermillion,
        Self::Green,
        Self::Orange,
        Self::Sky,
        Self::Purple,
        Self::Black,
        Self::Grey,
    ];

    /// The colour of the n-th of many things without an order, from 0.
    pub fn nth(index: usize) -> Self {
        // All but grey.
        Self::ALL[index % (Self::ALL.len() - 1)]
    }

    /// Red, green and blue on paper.
    pub fn rgb(self) -> Rgb {
        match self {
            Self::Blue => [0x00, 0x72, 0xb2],
            Self::Vermillion => [0xd5, 0x5e, 0x00],
            Self::Green => [0x00, 0x9e, 0x73],
            Self::Orange => [0xe6, 0x9f, 0x00],
            Self::Sky => [0x56, 0xb4, 0xe9],
            Self::Purple => [0xcc, 0x79, 0xa7],
            Self::Black => [0x00, 0x00, 0x00],
            Self::Grey => [0x8a, 0x8a, 0x8a],
        }
    }

    /// The same in front of a dark surface.
    fn rgb_on_dark(self) -> Rgb {
        match self {
            Self::Blue => [0x4d, 0xa8, 0xe8],
            Self::Vermillion => [0xff, 0x8a, 0x47],
            Self::Green => [0x35, 0xc4, 0x9a],
            Self::Orange => [0xf2, 0xb8, 0x45],
            Self::Sky => [0x93, 0xd2, 0xf7],
            Self::Purple => [0xe3, 0xa1, 0xc7],
            Self::Black => [0xf0, 0xf0, 0xf0],
            Self::Grey => [0x94, 0x9c, 0xa4],
        }
    }
}

/// The colour of a matrix cell: nearly white for 0, through blue to a blue that is nearly black, as its share grows to 1.
pub(crate) fn shade(share: f64) -> Rgb {
    // Not quite the sky of the palette: on dark surfaces the two differ.
    mixed([[244.0, 246.0, 248.0], [86.0, 180.0, 232.0], [0.0, 40.0, 90.0]], share)
}

/// Whether what is written on a cell of that share must be light.
pub(crate) fn needs_light_ink(share: f64) -> bool {
    share > 0.65
}

fn shade_on_dark(share: f64) -> Rgb {
    mixed([[36.0, 43.0, 50.0], [24.0, 92.0, 144.0], [214.0, 236.0, 255.0]], share)
}

fn mixed(stops: [[f64; 3]; 3], share: f64) -> Rgb {
    let steps = f64::from(SHADES);
    let share = if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 };
    let place = (share * steps).round() / steps * 2.0;
    let (from, share) = if place < 1.0 { (0, place) } else { (1, place - 1.0) };
    let mut rgb = [0; 3];
    for (part, (a, b)) in rgb.iter_mut().zip(stops[from].into_iter().zip(stops[from + 1])) {
        *part = (a + share * (b - a)).round() as u8;
    }
    rgb
}

/// Every colour that a figure has: its name in CSS, on paper and on a dark surface.
fn tones() -> impl Iterator<Item = (String, [Rgb; 2])> {
    let named = [
        ("ink".to_owned(), [INK, [0xdc, 0xe1, 0xe6]]),
        ("grid".to_owned(), [GRID, [0x32, 0x3a, 0x42]]),
        ("paper".to_owned(), [PAPER, DARK_SURFACE]),
    ];
    let colours = (1..).zip(Colour::ALL);
    let colours = colours.map(|(n, colour)| (format!("c{n}"), [colour.rgb(), colour.rgb_on_dark()]));
    let shades = (0..=SHADES).map(|step| {
        let share = f64::from(step) / f64::from(SHADES);
        (format!("h{step}"), [shade(share), shade_on_dark(share)])
    });
    named.into_iter().chain(colours).chain(shades)
}

/// What a page lies on where it is dark.
const DARK_SURFACE: Rgb = [0x14, 0x18, 0x1c];

/// The name of a colour in the classes of [`style`]: `f-NAME` fills, `l-NAME` draws lines.
pub(crate) fn class(rgb: Rgb) -> Option<String> {
    tones().find(|(_, [light, _])| *light == rgb).map(|(name, _)| name)
}

/// A colour as CSS has it.
pub(crate) fn css([r, g, b]: Rgb) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// Style rules of all colours: light, and dark where the reader wants it and nothing is printed.
pub(crate) fn style() -> String {
    let variables = |which: usize| {
        tones().fold(String::new(), |mut text, (name, rgb)| {
            let _ = write!(text, "--{name}:{};", css(rgb[which])); // writing to a String cannot fail
            text
        })
    };
    let mut style = format!(
        ":root{{{}}}\n@media screen and (prefers-color-scheme:dark){{:root{{{}}}}}\n",
        variables(0),
        variables(1)
    );
    for (name, _) in tones() {
        let _ = writeln!(style, ".f-{name}{{fill:var(--{name})}}.l-{name}{{stroke:var(--{name})}}");
    }
    style
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    fn luminance(rgb: Rgb) -> f64 {
        // Nearly the curve of sRGB, without a function that differs between platforms: to the power of 2.25.
        let part = |value: u8| {
            let share = f64::from(value) / 255.0;
            share * share * share.sqrt().sqrt()
        };
        0.2126 * part(rgb[0]) + 0.7152 * part(rgb[1]) + 0.0722 * part(rgb[2])
    }

    /// Contrast as WCAG 2 defines it.
    fn contrast(a: Rgb, b: Rgb) -> f64 {
        let [a, b] = [a, b].map(luminance);
        (a.max(b) + 0.05) / (a.min(b) + 0.05)
    }

    #[test]
    fn shades_go_one_way_and_what_is_written_on_them_is_read() {
        for share in 1..=32 {
            let [before, after] = [share - 1, share].map(|step| f64::from(step) / 32.0);
            assert!(luminance(shade(after)) < luminance(shade(before)), "{after}");
            let [ink, on_dark] = match needs_light_ink(after) {
                true => [PAPER, DARK_SURFACE],
                false => [Colour::Black.rgb(), Colour::Black.rgb_on_dark()],
            };
            assert!(contrast(ink, shade(after)) > 3.0, "{after}");
            assert!(contrast(on_dark, shade_on_dark(after)) > 3.0, "{after}");
        }
        assert_eq!(shade(f64::NAN), shade(0.0));
    }

    #[test]
    fn data_is_seen_on_dark_surfaces() {
        for colour in Colour::ALL {
            assert!(contrast(colour.rgb_on_dark(), DARK_SURFACE) > 4.5, "{colour:?}");
        }
    }

    #[test]
    fn every_colour_has_one_name() {
        let light: BTreeSet<Rgb> = tones().map(|(_, [light, _])| light).collect();
        assert_eq!(light.len(), tones().count());
        assert_eq!(class(Colour::Blue.rgb()).as_deref(), Some("c1"));
        assert_eq!(class([1, 2, 3]), None);
    }
}
