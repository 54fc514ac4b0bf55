//! Which evaluations are audited: given to a second worker as well.

use proto::task::Task;

/// A share of all evaluations, chosen by their tasks and never by when they are submitted.
///
/// Anybody who knows the seed can tell which evaluations are audited: a share below 1 finds machines that err, and only
/// 1 holds against one that means to deceive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Audit {
    /// 0 (none) to 1 (every one).
    pub share: f64,
    /// Of the experiment.
    pub seed: u64,
}

impl Audit {
    /// No evaluation.
    pub const NONE: Self = Self { share: 0.0, seed: 0 };

    /// Whether this task is audited.
    pub fn covers(&self, task: &Task) -> bool {
        if self.share <= 0.0 || self.share >= 1.0 {
            return self.share >= 1.0;
        }
        let mut hasher = blake3::Hasher::new_derive_key("descry audit v1");
        hasher.update(&self.seed.to_le_bytes());
        hasher.update(&task.job(0).0.to_le_bytes());
        let mut draw = [0; 8];
        draw.copy_from_slice(&hasher.finalize().as_bytes()[..8]);
        const BITS: u32 = f64::MANTISSA_DIGITS; // as many as a float holds exactly
        let draw = u64::from_le_bytes(draw) >> (u64::BITS - BITS);
        (draw as f64) < self.share * (1u64 << BITS) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proto::task::Evaluation;

    fn task(number: u32) -> Task {
        Task::Evaluation(Evaluation::sample(number, 10, 10))
    }

    #[test]
    fn about_the_share_that_is_asked_for_is_audited_and_the_seed_chooses_which() {
        let covered = |share, seed| -> Vec<u32> {
            (0..4000).filter(|&bins| Audit { share, seed }.covers(&task(bins))).collect()
        };
        assert!(covered(0.0, 1).is_empty());
        assert_eq!(covered(1.0, 1).len(), 4000);
        assert!((900..1100).contains(&covered(0.25, 1).len()), "{}", covered(0.25, 1).len());
        assert_eq!(covered(0.25, 1), covered(0.25, 1));
        assert_ne!(covered(0.25, 1), covered(0.25, 2));
    }
}
