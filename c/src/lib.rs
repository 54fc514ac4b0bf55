//! The C interface of `artefact`: an exported artefact is opened, describes clouds and names the objects in them.
//!
//! Each function here is an entry: it checks its arguments (`input`), calls `artefact`, and returns a status (`status`),
//! with words for the calling thread (`error`). `include/descry_recognise.h` is made of the comments in this file,
//! `status` and `answer`: they are written for readers of C. Its first part says what callers must keep to.

#![allow(clippy::missing_safety_doc, reason = "the header says for all functions what callers must keep to")]

mod answer;
mod error;
mod input;
mod status;

use std::ffi::{c_char, c_int};

use artefact::{Recogniser, Seconds};

use answer::descry_answer;
use error::{CallError, guarded};
use input::{Place, Places, cloud, path, shared};
use status::descry_status;

/// An artefact at work.
#[allow(non_camel_case_types, reason = "names of C")]
pub struct descry_recogniser {
    recogniser: Recogniser,
    channels: Vec<descry_channel>,
}

/// How many values one channel of a signature has.
#[allow(non_camel_case_types, reason = "names of C")]
#[repr(C)]
#[derive(Clone, Copy)]
pub struct descry_channel {
    /// Values of the centroid: the mean over keypoints.
    pub centroid: usize,
    /// Values of the standard deviation over keypoints: as many, or 0 in a channel of the whole cloud.
    pub deviation: usize,
}

impl descry_recogniser {
    fn values(&self) -> usize {
        self.channels.iter().map(|channel| channel.centroid + channel.deviation).sum()
    }
}

/// Threads share it.
const _: () = {
    const fn shared<T: Send + Sync>() {}
    shared::<descry_recogniser>();
};

/// The library's version, for example "0.3.0".
#[unsafe(no_mangle)]
pub extern "C" fn descry_version() -> *const c_char {
    const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), "\0");
    VERSION.as_ptr().cast()
}

/// The name of a status, for example "DESCRY_ERROR_READ"; of any other number "unknown status".
#[unsafe(no_mangle)]
pub extern "C" fn descry_status_name(status: c_int) -> *const c_char {
    status::name(status).as_ptr()
}

/// What went wrong in the last call of this thread that failed, in one line, "where: what, got value";
/// "" if none did. Valid until the next call of this thread that fails.
#[unsafe(no_mangle)]
pub extern "C" fn descry_error_what() -> *const c_char {
    error::last(false)
}

/// What to do about it, as descry_error_what().
#[unsafe(no_mangle)]
pub extern "C" fn descry_error_advice() -> *const c_char {
    error::last(true)
}

/// Opens the artefact in the folder `path`: reads and checks its files, which are not needed afterwards.
/// On failure, `*recogniser` is NULL.
///
/// Returns DESCRY_OK, or DESCRY_ERROR_ARGUMENT, _READ, _ARTEFACT or _VERSION.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn descry_recogniser_open(
    path: *const c_char,
    recogniser: *mut *mut descry_recogniser,
) -> descry_status {
    guarded(|| {
        // SAFETY: the header asks it of callers.
        let mut place = unsafe { Place::new("recogniser", recogniser, std::ptr::null_mut()) }?;
        descriptor::wide::check_environment()?;
        // SAFETY: the header asks it of callers.
        let opened = Recogniser::open(unsafe { self::path(path) }?)?;
        let channels = opened.lengths().map(|[centroid, deviation]| descry_channel { centroid, deviation });
        let channels = channels.collect();
        place.store(Box::into_raw(Box::new(descry_recogniser { recogniser: opened, channels })));
        Ok(())
    })
}

/// Frees a recogniser that no call uses any more. NULL is ignored.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn descry_recogniser_free(recogniser: *mut descry_recogniser) {
    guarded(|| {
        if !recogniser.is_null() {
            // SAFETY: `descry_recogniser_open` has made it of a box; the header asks callers to free it once.
            drop(unsafe { Box::from_raw(recogniser) });
        }
        Ok(())
    });
}

/// How the values of a signature are divided: the channels in their order, each the values of its centroid
/// and then those of its deviation. `channels` has room for `capacity` elements; `*needed` becomes how many
/// there are, at most 8. `channels` may be NULL if `capacity` is 0, `needed` may be NULL.
///
/// Returns DESCRY_OK, or DESCRY_ERROR_ARGUMENT or _BUFFER.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn descry_recogniser_channels(
    recogniser: *const descry_recogniser,
    channels: *mut descry_channel,
    capacity: usize,
    needed: *mut usize,
) -> descry_status {
    guarded(|| {
        // SAFETY: the header asks it of callers.
        let needed = unsafe { Place::optional("needed", needed, 0) }?;
        // SAFETY: the header asks it of callers.
        let recogniser = unsafe { shared("recogniser", recogniser) }?;
        if let Some(mut needed) = needed {
            needed.store(recogniser.channels.len());
        }
        // SAFETY: the header asks it of callers.
        unsafe { Places::new("channels", channels, capacity) }?.store(recogniser.channels.iter().copied())
    })
}

/// Describes a cloud: stores its signature in `values`, which has room for `capacity` numbers. `*needed`
/// becomes how many a signature has, the same for every cloud; it is known at once, so that a call without
/// room describes nothing. `values` may be NULL if `capacity` is 0, `needed` may be NULL.
///
/// Returns DESCRY_OK, or DESCRY_ERROR_ARGUMENT, _BUFFER or _CLOUD.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn descry_recogniser_describe(
    recogniser: *const descry_recogniser,
    xyz: *const f32,
    rgb: *const u8,
    points: usize,
    viewpoint: *const f32,
    values: *mut f32,
    capacity: usize,
    needed: *mut usize,
) -> descry_status {
    guarded(|| {
        // SAFETY: the header asks it of callers.
        let needed = unsafe { Place::optional("needed", needed, 0) }?;
        // SAFETY: the header asks it of callers.
        let recogniser = unsafe { shared("recogniser", recogniser) }?;
        let count = recogniser.values();
        if let Some(mut needed) = needed {
            needed.store(count);
        }
        // SAFETY: the header asks it of callers.
        let mut values = unsafe { Places::new("values", values, capacity) }?;
        values.check(count)?;
        // SAFETY: the header asks it of callers.
        let cloud = unsafe { cloud(xyz, rgb, points, viewpoint) }?;
        let described = recogniser.recogniser.describe_cloud(&cloud, &mut Seconds::default())?;
        let parts = described.signatures.iter().flat_map(|one| [&one.centroid, &one.deviation]);
        let signature: Vec<f32> = parts.flatten().copied().collect();
        if signature.len() != count {
            let found = format!("{} values instead of {count}", signature.len());
            return Err(CallError::Internal(found));
        }
        values.store(signature)
    })
}

/// Names the object in a cloud: the `most` nearest objects, at least 1. The answer is to be freed by
/// descry_answer_free; on failure, `*answer` is NULL. That an object is unknown is an answer.
///
/// Returns DESCRY_OK, or DESCRY_ERROR_ARGUMENT or _CLOUD.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn descry_recogniser_recognise(
    recogniser: *const descry_recogniser,
    xyz: *const f32,
    rgb: *const u8,
    points: usize,
    viewpoint: *const f32,
    most: usize,
    answer: *mut *mut descry_answer,
) -> descry_status {
    guarded(|| {
        // SAFETY: the header asks it of callers.
        let mut place = unsafe { Place::new("answer", answer, std::ptr::null_mut()) }?;
        // SAFETY: the header asks it of callers.
        let recogniser = unsafe { shared("recogniser", recogniser) }?;
        if most == 0 {
            return Err(CallError::NoObject);
        }
        // SAFETY: the header asks it of callers.
        let cloud = unsafe { cloud(xyz, rgb, points, viewpoint) }?;
        let described = recogniser.recogniser.describe_cloud(&cloud, &mut Seconds::default())?;
        place.store(answer::into_raw(&recogniser.recogniser.answer(&described, most)));
        Ok(())
    })
}

/// Frees an answer. NULL is ignored.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn descry_answer_free(answer: *mut descry_answer) {
    guarded(|| {
        if !answer.is_null() {
            // SAFETY: `descry_recogniser_recognise` has made it; the header asks callers to free it once.
            unsafe { answer::free(answer) };
        }
        Ok(())
    });
}
