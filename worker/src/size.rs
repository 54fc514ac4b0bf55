//! Sizes of memory and caches, as people write them.

use std::fmt;
use std::str::FromStr;

/// Units that are understood; the first is the fallback, decimal and binary are told apart by the `i`.
const UNITS: [(&str, u64); 7] = [
    ("B", 1),
    ("KiB", 1 << 10),
    ("MiB", 1 << 20),
    ("GiB", 1 << 30),
    ("KB", 1_000),
    ("MB", 1_000_000),
    ("GB", 1_000_000_000),
];

/// A number of bytes, at least 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Size(u64);

/// A text that is no size.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("size: {what}, got {got}\nwrite it like 600MiB or 2GiB")]
pub struct InvalidSize {
    what: &'static str,
    got: String,
}

impl Size {
    /// At least one byte.
    pub const fn from_bytes(bytes: u64) -> Self {
        Self(if bytes == 0 { 1 } else { bytes })
    }

    /// The number of bytes.
    pub const fn bytes(self) -> u64 {
        self.0
    }
}

impl FromStr for Size {
    type Err = InvalidSize;

    fn from_str(text: &str) -> Result<Self, InvalidSize> {
        let wrong = |what| InvalidSize { what, got: text.to_owned() };
        let digits = text.find(|c: char| !c.is_ascii_digit()).ok_or_else(|| wrong("must end in a unit"))?;
        let (number, unit) = text.split_at(digits);
        let number: u64 = number.parse().map_err(|_| wrong("must begin with a whole number below 2^64"))?;
        let unit = unit.trim_start();
        let (_, scale) = UNITS
            .iter()
            .find(|(name, _)| name.eq_ignore_ascii_case(unit))
            .ok_or_else(|| wrong("unit must be B, KiB, MiB, GiB, KB, MB or GB"))?;
        match number.checked_mul(*scale) {
            Some(0) => Err(wrong("must be more than nothing")),
            Some(bytes) => Ok(Self(bytes)),
            None => Err(wrong("must be below 2^64 bytes")),
        }
    }
}

impl fmt::Display for Size {
    /// Whole numbers of the largest binary unit that leaves at least ten of them, rounded down.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let fits = |&&(_, scale): &&(&str, u64)| self.0 / scale >= 10;
        let (name, scale) = UNITS[..4].iter().rev().find(fits).unwrap_or(&UNITS[0]);
        write!(f, "{} {name}", self.0 / scale)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_numbers_with_a_unit() {
        for (text, bytes) in [
            ("1B", 1),
            ("600MiB", 600 << 20),
            ("2GiB", 2 << 30),
            ("2 gib", 2 << 30),
            ("64KiB", 64 << 10),
            ("64KB", 64_000),
            ("5MB", 5_000_000),
            ("20GB", 20_000_000_000),
            ("18446744073709551615B", u64::MAX),
        ] {
            assert_eq!(text.parse::<Size>().unwrap().bytes(), bytes, "{text}");
        }
    }

    #[test]
    fn nonsense_is_refused_with_an_example() {
        for text in [
            "",
            "600",
            "MiB",
            "-1MiB",
            "1.5GiB",
            "1e3B",
            "0MiB",
            "1TB",
            "1Mib/s",
            "18446744073709551616B",
            "18446744073709551615KiB",
            "٣MiB",
        ] {
            let message = text.parse::<Size>().unwrap_err().to_string();
            assert!(message.starts_with("size: "), "{text}: {message}");
            assert!(message.ends_with(&format!("got {text}\nwrite it like 600MiB or 2GiB")), "{message}");
        }
    }

    #[test]
    fn sizes_are_shown_in_a_unit_that_fits() {
        for (bytes, shown) in [(1, "1 B"), (10 << 10, "10 KiB"), (600 << 20, "600 MiB"), (20 << 30, "20 GiB")]
        {
            assert_eq!(Size::from_bytes(bytes).to_string(), shown);
        }
        assert_eq!(Size::from_bytes(2 << 30).to_string(), "2048 MiB");
    }
}
