//! Feeds nearly right input to every reader of bytes from outside: `cargo run --release --bin fuzz -- --seconds 180`.
//!
//! Each input follows from the seed and its number, so that a failure is found again by `--seed N --only NAME`. A panic
//! ends the run; its input is kept in the temporary folder that the message names.

mod mutate;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::Parser;
use descriptor::random;
use tests::readers::{self, Reader};

/// Feed nearly right input to every reader of bytes from outside.
#[derive(Debug, Parser)]
struct Args {
    /// How long, in all
    #[arg(long, default_value_t = 20)]
    seconds: u64,
    /// Another seed gives other inputs
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// One reader alone, by name
    #[arg(long)]
    only: Option<String>,
    /// Write the inputs to begin with into this folder, one below it for each target of cargo-fuzz, and end
    #[arg(long, value_name = "DIR")]
    corpus: Option<PathBuf>,
}

fn main() {
    let args = Args::parse();
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut readers = readers::all(folder.path().to_owned());
    readers.retain(|reader| args.only.as_ref().is_none_or(|only| only == reader.name));
    assert!(!readers.is_empty(), "--only: no reader of that name, got {:?}", args.only);
    for reader in &readers {
        let accepted = reader.seeds.iter().filter(|seed| (reader.feed)(seed)).count();
        assert_eq!(accepted, reader.seeds.len(), "{}: a seed is refused", reader.name);
    }
    if let Some(corpus) = &args.corpus {
        return write_corpus(&readers, corpus);
    }
    let share = Duration::from_secs(args.seconds) / readers.len() as u32;
    for reader in &readers {
        let (begun, mut inputs, mut accepted) = (Instant::now(), 0u64, 0u64);
        while begun.elapsed() < share {
            let mut rng = random::stream(args.seed, reader.name, &[inputs]);
            let input = mutate::mutate(&mut rng, &reader.seeds, reader.words);
            match catch_unwind(AssertUnwindSafe(|| (reader.feed)(&input))) {
                Ok(good) => accepted += u64::from(good),
                Err(_) => {
                    let kept = folder.keep().join("input");
                    std::fs::write(&kept, &input).expect("room for the input");
                    eprintln!("{}: input {inputs} of seed {}: {}", reader.name, args.seed, kept.display());
                    std::process::exit(1);
                }
            }
            inputs += 1;
        }
        println!("{}: {inputs} inputs, {accepted} accepted, no panic", reader.name);
    }
}

/// Writes the seeds of each reader into the folder that cargo-fuzz takes them from.
fn write_corpus(readers: &[Reader], corpus: &Path) {
    for reader in readers {
        let folder = corpus.join(reader.name.replace(' ', "-"));
        std::fs::create_dir_all(&folder).expect("a folder for the corpus");
        for (number, seed) in reader.seeds.iter().enumerate() {
            std::fs::write(folder.join(format!("seed-{number}")), seed).expect("room for the corpus");
        }
        println!("{}: {} seeds", folder.display(), reader.seeds.len());
    }
}
