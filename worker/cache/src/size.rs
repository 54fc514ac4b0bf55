//! Sizes of memory and caches, as people write them.

use bytesize::{ByteSize, GIB, Unit};

/// A text that is no size.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("size: {what}, got {got}\nwrite it like 600MiB or 2GiB")]
pub struct InvalidSize {
    what: &'static str,
    got: String,
}

/// A whole number of bytes, at least 1, with its unit. `bytesize` alone takes bare numbers and fractions, and cuts what is
/// too large.
pub fn parse_size(text: &str) -> Result<ByteSize, InvalidSize> {
    let wrong = |what| InvalidSize { what, got: text.to_owned() };
    let digits = text.find(|c: char| !c.is_ascii_digit()).ok_or_else(|| wrong("must end in a unit"))?;
    let (number, unit) = text.split_at(digits);
    let number: u64 = number.parse().map_err(|_| wrong("must begin with a whole number below 2^64"))?;
    let unit = unit.trim_start();
    let scale = unit.parse::<Unit>().map_or(u64::MAX, |unit| 1 * unit);
    if scale > GIB || !unit.ends_with(['b', 'B']) {
        return Err(wrong("unit must be B, KiB, MiB, GiB, KB, MB or GB"));
    }
    match number.checked_mul(scale) {
        Some(0) => Err(wrong("must be more than nothing")),
        Some(bytes) => Ok(ByteSize(bytes)),
        None => Err(wrong("must be below 2^64 bytes")),
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
            assert_eq!(parse_size(text).unwrap().as_u64(), bytes, "{text}");
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
            "1TiB",
            "5M",
            "5Mi",
            "1EB",
            "1Mib/s",
            "18446744073709551616B",
            "18446744073709551615KiB",
            "٣MiB",
        ] {
            let message = parse_size(text).unwrap_err().to_string();
            assert!(message.starts_with("size: "), "{text}: {message}");
            assert!(message.ends_with(&format!("got {text}\nwrite it like 600MiB or 2GiB")), "{message}");
        }
    }
}
