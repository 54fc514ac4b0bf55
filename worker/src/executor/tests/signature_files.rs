//! Signatures of structures on disk: read by whoever comes later, and never believed when they are damaged.

use descriptor::structure::StructureSpace;

use super::*;

const CHANNELS: u64 = 2;

fn asked(archive: &Archive) -> Task {
    Task::Evaluation(structure_evaluation(archive))
}

/// An evaluation of a structure with two channels.
pub(super) fn structure_evaluation(archive: &Archive) -> Evaluation {
    let space = StructureSpace::default();
    // Pairs of all four kinds are described alike; these two are the cheapest.
    let of_slot = |active: u32, pairs: u32| [vec![active, pairs, 0, 13], vec![0; 11]].concat();
    let indices = [of_slot(1, 3), of_slot(1, 2), of_slot(0, 0), of_slot(0, 0)].concat();
    let structure = space.decode(&indices).unwrap();
    assert_eq!(structure.channels.len() as u64, CHANNELS);
    let space = SearchSpace::Structures(space);
    let preparation = Preparation { preprocess: Preprocess::default(), space };
    let [query, database] = splits(archive, false);
    let subject = subject(&preparation, Descriptor::Structure(structure).to_bytes());
    Evaluation { subject, query, database, ..Evaluation::sample(0, 0, 0) }
}

#[tokio::test(flavor = "multi_thread")]
async fn signatures_on_disk_are_those_that_would_be_computed() {
    let (archive, cache) = (Archive::new(), tempfile::tempdir().unwrap());
    let executor = |cache: Option<&Path>| executor(&archive, LARGE, &store(cache.map(Path::to_owned)));
    let plain = executor(None);
    let expected = carry_out(&plain, asked(&archive)).await;
    assert_eq!((plain.work().described, plain.work().restored), (CHANNELS * 2 * SPLIT, 0));

    // (signatures computed, signatures read) by one worker after the other
    let disk = Some(cache.path());
    for (described, restored) in [(CHANNELS * 2 * SPLIT, 0), (0, CHANNELS * 2 * SPLIT)] {
        let executor = executor(disk);
        assert_eq!(carry_out(&executor, asked(&archive)).await, expected);
        let work = executor.work();
        assert_eq!((work.described, work.restored), (described, restored));
        if restored > 0 {
            assert_eq!((work.prepared, work.loaded), (0, 0), "clouds are not needed");
        }
    }

    let of_signatures = |file: &PathBuf| file.iter().any(|part| part == "signatures-2");
    let kept: Vec<PathBuf> = files(cache.path()).into_iter().filter(of_signatures).collect();
    assert_eq!(kept.len() as u64, CHANNELS * 2, "{kept:?}");
    let mut bytes = fs::read(&kept[0]).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    fs::write(&kept[0], bytes).unwrap();
    fs::write(&kept[1], b"").unwrap();
    for damaged in [2, 0] {
        let executor = executor(disk);
        assert_eq!(carry_out(&executor, asked(&archive)).await, expected);
        let work = executor.work();
        let all = CHANNELS * 2 * SPLIT;
        assert_eq!((work.described, work.restored), (damaged * SPLIT, all - damaged * SPLIT));
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn signatures_of_other_families_are_not_kept() {
    let (archive, cache) = (Archive::new(), tempfile::tempdir().unwrap());
    let executor = executor(&archive, LARGE, &store(Some(cache.path().to_owned())));
    carry_out(&executor, task(&archive, descriptors()[0], false)).await;
    assert!(files(cache.path()).iter().all(|file| file.iter().all(|part| part != "signatures-2")));
}
