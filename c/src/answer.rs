//! Answers as C reads them: structs of pointers into memory that the answer owns.

use std::ffi::{CString, c_char};

use artefact::{Answer, Named};

use crate::error::text;

/// An object by the reference cloud that is nearest, or most like the cloud that was asked about.
#[allow(non_camel_case_types, reason = "names of C")]
#[repr(C)]
pub struct descry_named {
    /// The object.
    pub instance: *const c_char,
    /// The object's category.
    pub category: *const c_char,
    /// The reference cloud: its path below the folder of data that the artefact was made of.
    pub cloud: *const c_char,
    /// Set distance to the reference cloud; of a recogniser that learns, 1 less the object's score.
    pub distance: f64,
}

/// What a cloud was recognised as. Only the library makes answers; later versions may add members at the end.
#[allow(non_camel_case_types, reason = "names of C")]
#[repr(C)]
pub struct descry_answer {
    /// The nearest objects, nearest first.
    pub ranking: *const descry_named,
    /// How many there are: at least 1, and no more than were asked for or the artefact knows.
    pub count: usize,
    /// Whether the object is none that the artefact knows. `ranking` then says what it is most like.
    pub unknown: bool,
    /// How probably the artefact knows the object, 0 to 1, if it knows half of what it is asked; -1 if
    /// the artefact has no rule for unknown objects, so that every answer is believed.
    pub known_probability: f64,
}

/// An answer with what it points to. The answer comes first, so that its address is that of the whole.
#[repr(C)]
struct OwnedAnswer {
    answer: descry_answer,
    ranking: Vec<descry_named>,
    texts: Vec<[CString; 3]>,
}

/// The answer on the heap, until [`free`].
pub fn into_raw(answer: &Answer<'_>) -> *mut descry_answer {
    let texts: Vec<[CString; 3]> =
        answer.ranking.iter().map(|one| [one.instance, one.category, one.cloud].map(text)).collect();
    let named = |(one, [instance, category, cloud]): (&Named<'_>, &[CString; 3])| descry_named {
        instance: instance.as_ptr(),
        category: category.as_ptr(),
        cloud: cloud.as_ptr(),
        distance: one.distance,
    };
    let ranking: Vec<descry_named> = answer.ranking.iter().zip(&texts).map(named).collect();
    let public = descry_answer {
        ranking: ranking.as_ptr(),
        count: ranking.len(),
        unknown: answer.is_unknown(),
        known_probability: answer.known.map_or(-1.0, |known| known.probability),
    };
    // What vectors point to stays where it is when they move.
    Box::into_raw(Box::new(OwnedAnswer { answer: public, ranking, texts })).cast()
}

/// Frees an answer.
///
/// # Safety
/// It comes from [`into_raw`], and nobody uses it any more.
pub unsafe fn free(answer: *mut descry_answer) {
    // SAFETY: `into_raw` has made it of a box of this type.
    let OwnedAnswer { answer: _, ranking, texts } = *unsafe { Box::from_raw(answer.cast::<OwnedAnswer>()) };
    drop((ranking, texts));
}

#[cfg(test)]
mod tests {
    use std::ffi::CStr;
    use std::slice;

    use artefact::Known;

    use super::*;

    fn read(text: *const c_char) -> String {
        // SAFETY: the texts of an answer end in NUL and live as long as it.
        unsafe { CStr::from_ptr(text) }.to_str().unwrap().to_owned()
    }

    #[test]
    fn what_c_reads_is_what_was_answered() {
        let named = |instance, distance| Named { instance, category: "mug", cloud: "mug/ä.pcd", distance };
        let ranking = vec![named("mug_1", 0.25), named("", 0.5)];
        for known in [None, Some(Known { probability: 0.25, is_accepted: false })] {
            let answer = Answer { ranking: ranking.clone(), evidence: None, known };
            let raw = into_raw(&answer);
            // SAFETY: `into_raw` has just made it.
            let public = unsafe { &*raw };
            // SAFETY: so many elements are there.
            let found = unsafe { slice::from_raw_parts(public.ranking, public.count) };
            for (found, named) in found.iter().zip(&ranking) {
                let texts = [found.instance, found.category, found.cloud].map(read);
                assert_eq!(texts, [named.instance, named.category, named.cloud]);
                assert_eq!(found.distance.to_bits(), named.distance.to_bits());
            }
            assert_eq!(found.len(), 2);
            assert_eq!(
                (public.unknown, public.known_probability),
                known.map_or((false, -1.0), |_| (true, 0.25))
            );
            // SAFETY: it is used no more.
            unsafe { free(raw) };
        }
    }
}
