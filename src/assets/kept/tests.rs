use super::*;
use proptest::prelude::*;
use std::convert::Infallible;

/// The square roots of numbers.
struct Roots(Vec<f64>);

impl KeptInput for Roots {
    const KIND: &'static str = "roots";
    const VERSION: u32 = 3;
    type Output = Vec<f64>;

    fn hashed(&self) -> impl Serialize {
        &self.0
    }

    fn accepts(&self, output: &Vec<f64>) -> bool {
        output.len() == self.0.len()
    }
}

/// The same of a later version.
struct LaterRoots(Vec<f64>);

impl KeptInput for LaterRoots {
    const KIND: &'static str = "roots";
    const VERSION: u32 = 4;
    type Output = Vec<f64>;

    fn hashed(&self) -> impl Serialize {
        &self.0
    }

    fn accepts(&self, _: &Vec<f64>) -> bool {
        true
    }
}

fn roots(input: &[f64]) -> Vec<f64> {
    input.iter().map(|x| x.sqrt()).collect()
}

/// Roots by a cache in a folder, and whether they had to be computed.
fn run(folder: &Path, input: &[f64]) -> (Vec<f64>, bool) {
    let cache = Cache::new(Some(folder));
    let Ok(found) = cache.keep(&Roots(input.to_vec()), || Ok::<_, Infallible>(roots(input)));
    (found, cache.computed() > 0)
}

fn folder(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("halflight-kept-{name}-{}", std::process::id()));
    let _ = std::fs::remove_dir_all(&folder);
    folder
}

fn file(folder: &Path, input: &[f64]) -> PathBuf {
    Cache::new(Some(folder)).file(&Roots(input.to_vec())).unwrap().0
}

#[test]
fn what_is_kept_is_not_computed_again() {
    let folder = folder("again");
    let input = [2.0, 3.0];
    assert_eq!(run(&folder, &input), (roots(&input), true));
    assert_eq!(run(&folder, &input), (roots(&input), false));
    // Another input, and another version of the computing.
    assert!(run(&folder, &[2.0, 3.1]).1 && run(&folder, &[2.0]).1);
    let hash = |input: &Roots| hash_of(input).unwrap();
    assert_ne!(hash(&Roots(vec![2.0])), hash_of(&LaterRoots(vec![2.0])).unwrap());
    // An error is given back and not kept.
    let cache = Cache::new(Some(&folder));
    assert_eq!(cache.keep(&Roots(vec![9.0]), || Err("no")), Err("no"));
    assert!(run(&folder, &[9.0]).1);
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn without_a_folder_everything_is_computed() {
    let cache = Cache::default();
    for _ in 0..2 {
        assert_eq!(cache.keep(&Roots(vec![4.0]), || Ok::<_, Infallible>(vec![2.0])), Ok(vec![2.0]));
    }
    assert_eq!(cache.computed(), 2);
}

#[test]
fn a_folder_that_cannot_be_written_is_no_error() {
    let folder = folder("nowhere");
    std::fs::write(&folder, "a file").unwrap();
    assert!(run(&folder, &[2.0]).1 && run(&folder, &[2.0]).1);
    std::fs::remove_file(&folder).unwrap();
}

/// A sound file under another name, one of another version of the format, and one whose result does not fit its input.
#[test]
fn foreign_files_are_not_taken() {
    let folder = folder("foreign");
    let (own, other) = ([2.0, 3.0], [5.0, 6.0]);
    run(&folder, &own);
    run(&folder, &other);
    let target = file(&folder, &own);
    let sound = std::fs::read(&target).unwrap();
    let hash = hash_of(&Roots(own.to_vec())).unwrap();
    let mut newer = sound.clone();
    newer[7] += 1;
    let checksum_at = newer.len() - HASH;
    let checksum = Sha256::digest(&newer[..checksum_at]);
    newer[checksum_at..].copy_from_slice(&checksum);
    let mut longer = encode(&hash, &roots(&own)).unwrap();
    assert_eq!(longer, sound);
    longer.truncate(checksum_at);
    longer.push(0);
    let checksum = Sha256::digest(&longer);
    longer.extend_from_slice(&checksum);
    let short = encode(&hash, &vec![1.0f64]).unwrap();
    let of_other = std::fs::read(file(&folder, &other)).unwrap();
    for foreign in [of_other, newer, longer, short] {
        std::fs::write(&target, foreign).unwrap();
        assert_eq!(run(&folder, &own), (roots(&own), true));
        assert_eq!(std::fs::read(&target).unwrap(), sound, "mended");
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

proptest! {
    #[test]
    fn damage_is_noticed_and_mended(
        cut in any::<Option<prop::sample::Index>>(),
        flips in prop::collection::vec((any::<prop::sample::Index>(), 1u8..), 0..4),
        longer in 0usize..3,
    ) {
        let folder = folder("damage");
        let input = [2.0, 3.0, 5.0];
        run(&folder, &input);
        let file = file(&folder, &input);
        let sound = std::fs::read(&file).unwrap();
        let mut bytes = sound.clone();
        bytes.truncate(cut.map_or(sound.len(), |cut| cut.index(sound.len())));
        for (at, bits) in flips.iter().filter(|_| !bytes.is_empty()).collect::<Vec<_>>() {
            let at = at.index(bytes.len());
            bytes[at] ^= bits;
        }
        bytes.extend(vec![0; longer]);
        std::fs::write(&file, &bytes).unwrap();
        prop_assert_eq!(run(&folder, &input), (roots(&input), bytes != sound));
        prop_assert_eq!(std::fs::read(&file).unwrap(), sound);
        std::fs::remove_dir_all(&folder).unwrap();
    }

    /// Even where the checksum is right.
    #[test]
    fn any_content_is_judged(content in prop::collection::vec(any::<u8>(), 0..200)) {
        let hash = [7; HASH];
        let mut bytes = [&FORMAT[..], &hash, &content].concat();
        let checksum = Sha256::digest(&bytes);
        bytes.extend_from_slice(&checksum);
        let _ = decode::<Vec<f64>>(&bytes, &hash);
        let _ = decode::<(crate::nearfield::probe::Mapped, crate::nearfield::sent::Sent)>(&bytes, &hash);
        let _ = decode::<crate::nearfield::irradiance::IrradianceVolume>(&bytes, &hash);
        let _ = decode::<Vec<f64>>(&content, &hash);
    }
}
