//! Inputs that are nearly right: what parsers meet from damaged files, other releases and people who mean harm.

use rand::{Rng, RngExt as _};

/// Numbers at which lengths and counts go wrong, little-endian, in up to eight bytes.
const EDGES: [u64; 8] = [0, 1, 0x7F, 0xFF, 0x7FFF_FFFF, 0xFFFF_FFFF, i64::MAX as u64, u64::MAX];
/// Longest input, bytes.
const MOST: usize = 1 << 20;

/// A seed changed in some places; once in a while nothing but random bytes.
pub fn mutate(rng: &mut impl Rng, seeds: &[Vec<u8>], words: &[&str]) -> Vec<u8> {
    if rng.random_range(0..50) == 0 {
        let length = rng.random_range(0..512usize);
        return (0..length).map(|_| rng.random()).collect();
    }
    let mut input = seeds[rng.random_range(0..seeds.len())].clone();
    for _ in 0..rng.random_range(1..=6u32) {
        change(rng, &mut input, seeds, words);
    }
    input.truncate(MOST);
    input
}

fn change(rng: &mut impl Rng, input: &mut Vec<u8>, seeds: &[Vec<u8>], words: &[&str]) {
    let at = place(rng, input.len());
    match rng.random_range(0..8u32) {
        0 if at < input.len() => input[at] ^= 1 << rng.random_range(0..8u32),
        1 if at < input.len() => input[at] = rng.random(),
        2 => input.truncate(at),
        3 => {
            let end = (at + rng.random_range(1..64usize)).min(input.len());
            drop(input.drain(at..end));
        }
        4 => {
            let end = (at + rng.random_range(1..64usize)).min(input.len());
            let piece = input[at..end].to_vec();
            let to = place(rng, input.len());
            drop(input.splice(to..to, piece));
        }
        5 => {
            let edge = EDGES[rng.random_range(0..EDGES.len())].to_le_bytes();
            let width = [1, 2, 4, 8][rng.random_range(0..4usize)];
            let end = (at + width).min(input.len());
            drop(input.splice(at..end, edge[..width].iter().copied()));
        }
        6 if !words.is_empty() => {
            let word = words[rng.random_range(0..words.len())];
            let end = (at + rng.random_range(0..12usize)).min(input.len());
            drop(input.splice(at..end, word.bytes()));
        }
        _ => {
            let other = &seeds[rng.random_range(0..seeds.len())];
            let from = place(rng, other.len());
            input.truncate(at);
            input.extend_from_slice(&other[from..]);
        }
    }
}

/// A place in so many bytes, or their end.
fn place(rng: &mut impl Rng, length: usize) -> usize {
    rng.random_range(0..=length as u64) as usize
}
