//! Names of experiments, variants, descriptors and sets of clouds: fit for a folder and for a key of TOML.

/// Whether a letter may stand in a name.
pub fn is_allowed(letter: char) -> bool {
    letter.is_ascii_lowercase() || letter.is_ascii_digit() || letter == '-' || letter == '_'
}

/// Whether a name is fit for a folder or a file: no separator, no leading dot, nothing that looks like an option.
pub fn is_name(name: &str) -> bool {
    (1..=64).contains(&name.len()) && !name.starts_with('-') && name.chars().all(is_allowed)
}
