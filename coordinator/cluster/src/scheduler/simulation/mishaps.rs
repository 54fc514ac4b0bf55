//! What went wrong in schedules, by kind.

use std::ops::AddAssign;

macro_rules! mishaps {
    ($($kind:ident)*) => {
        /// How often what went wrong.
        #[derive(Clone, Copy, Debug, Default)]
        pub struct Mishaps {
            $(pub $kind: u64,)*
        }

        impl Mishaps {
            pub fn each_happened(&self) -> bool {
                [$(self.$kind),*].iter().all(|count| *count > 0)
            }
        }

        impl AddAssign for Mishaps {
            fn add_assign(&mut self, other: Self) {
                $(self.$kind += other.$kind;)*
            }
        }
    };
}

mishaps! { lost doubled crashed left cut paused reconnected failed disagreed quarantined excluded stolen sybils held prioritised drained hung passive tried }
