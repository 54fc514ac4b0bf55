//! Why a call failed: its status, and what the calling thread remembers of it in words. No panic leaves the library.

use std::any::Any;
use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};

use artefact::{ArtefactError, BufferError, CloudError, DatabaseError};
use descriptor::wide::VectorsError;
use proto::Message;

use crate::status::descry_status;

/// Why a call failed.
#[derive(Debug, thiserror::Error)]
pub enum CallError {
    /// A pointer to nothing.
    #[error("{0}: must point to something, got NULL\n{ARGUMENTS}")]
    Null(&'static str),
    /// A pointer to what cannot be an object of its type.
    #[error("{name}: must be aligned to {alignment} bytes, got an address {rest} bytes off\n{ARGUMENTS}")]
    Misaligned {
        /// Which argument.
        name: &'static str,
        /// Bytes.
        alignment: usize,
        /// The address modulo that.
        rest: usize,
    },
    /// It would mean the folder that the program happens to be in.
    #[error("path: must name a folder, got an empty text\nname a folder that coordinator export has made")]
    NoPath,
    /// Only where paths are Unicode.
    #[cfg(not(unix))]
    #[error("path: must be UTF-8, got other bytes\nconvert it from the code page of the program")]
    NotUtf8,
    /// No answer is without an object.
    #[error("most: must be at least 1, got 0\nask for the nearest object, or for several")]
    NoObject,
    /// Less room than there are elements.
    #[error(
        "capacity: must be at least {needed}, got {capacity}\ncall again with an array of that many elements"
    )]
    Buffer {
        /// Elements.
        needed: usize,
        /// Elements that there is room for.
        capacity: usize,
    },
    /// A setting of the environment that the programs refuse, too.
    #[error(transparent)]
    Environment(#[from] VectorsError),
    /// Arrays that are no cloud.
    #[error(transparent)]
    Arrays(#[from] BufferError),
    /// A folder that is no artefact.
    #[error(transparent)]
    Artefact(#[from] ArtefactError),
    /// A cloud without an answer.
    #[error(transparent)]
    Cloud(#[from] CloudError),
    /// A panic, or something else that cannot be.
    #[error(
        "library: must not fail here, got {0}\nreport this defect of libdescry_recognise with the artefact and the cloud"
    )]
    Internal(String),
}

const ARGUMENTS: &str = "correct the call; descry_recognise.h says what each argument is";

impl CallError {
    /// What the call returns.
    pub fn status(&self) -> descry_status {
        use descry_status::*;
        match self {
            Self::Null(_)
            | Self::Misaligned { .. }
            | Self::NoPath
            | Self::NoObject
            | Self::Environment(_)
            | Self::Arrays(_) => DESCRY_ERROR_ARGUMENT,
            #[cfg(not(unix))]
            Self::NotUtf8 => DESCRY_ERROR_ARGUMENT,
            Self::Buffer { .. } => DESCRY_ERROR_BUFFER,
            Self::Artefact(error) => match error {
                ArtefactError::Read { .. } => DESCRY_ERROR_READ,
                ArtefactError::Unreadable(DatabaseError::Newer { .. }) => DESCRY_ERROR_VERSION,
                ArtefactError::Unreadable(_) => DESCRY_ERROR_READ,
                ArtefactError::Version { .. } | ArtefactError::EvaluationVersion { .. } => {
                    DESCRY_ERROR_VERSION
                }
                ArtefactError::Settings { .. }
                | ArtefactError::Descriptor(_)
                | ArtefactError::Database { .. }
                | ArtefactError::Digest { .. } => DESCRY_ERROR_ARTEFACT,
            },
            Self::Cloud(_) => DESCRY_ERROR_CLOUD,
            Self::Internal(_) => DESCRY_ERROR_INTERNAL,
        }
    }
}

/// An error as C reads it.
#[derive(Default)]
struct Remembered {
    what: CString,
    advice: CString,
}

thread_local! {
    static LAST: RefCell<Remembered> = RefCell::default();
}

fn remember(error: &CallError) {
    let Message { what, advice } = Message::of(error);
    let [what, advice] = [what, advice].map(text);
    // A thread that ends has nobody to ask what it remembers.
    let _ = LAST.try_with(|last| *last.borrow_mut() = Remembered { what, advice });
}

/// A text for C, which ends at the first NUL.
pub fn text(text: impl Into<String>) -> CString {
    let text = text.into().replace('\0', "\u{fffd}");
    CString::new(text).unwrap_or_default()
}

/// What went wrong, or what to do, in the last call of this thread that failed; valid until the next that does.
pub fn last(is_advice: bool) -> *const c_char {
    let pointer = |last: &RefCell<Remembered>| {
        let last = last.borrow();
        let text: &CStr = if is_advice { &last.advice } else { &last.what };
        text.as_ptr()
    };
    LAST.try_with(pointer).unwrap_or(c"".as_ptr())
}

/// Runs a call; a panic in it is an error like any other.
pub fn guarded(call: impl FnOnce() -> Result<(), CallError>) -> descry_status {
    let failed = |panic: Box<dyn Any + Send>| Err(CallError::Internal(words(&*panic)));
    match catch_unwind(AssertUnwindSafe(call)).unwrap_or_else(failed) {
        Ok(()) => descry_status::DESCRY_OK,
        Err(error) => {
            remember(&error);
            error.status()
        }
    }
}

/// What a panic says, in one line.
fn words(panic: &(dyn Any + Send)) -> String {
    let said = panic.downcast_ref::<String>().map(String::as_str).or_else(|| panic.downcast_ref().copied());
    let said = said.unwrap_or("a panic without words");
    said.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}

#[cfg(not(panic = "unwind"))]
compile_error!("panics must unwind, or they end the program that calls: build with panic = \"unwind\"");

#[cfg(test)]
mod tests {
    use super::*;

    fn remembered() -> [String; 2] {
        [false, true].map(|is_advice| {
            // SAFETY: `last` returns a text that this thread keeps until its next failure.
            unsafe { CStr::from_ptr(last(is_advice)) }.to_str().unwrap().to_owned()
        })
    }

    #[test]
    fn a_panic_is_a_status_and_words() {
        assert_eq!(remembered(), ["", ""]);
        assert_eq!(guarded(|| panic!("line {}\nand more", 1)), descry_status::DESCRY_ERROR_INTERNAL);
        let [what, advice] = remembered();
        assert_eq!(what, "library: must not fail here, got line 1 and more");
        assert!(advice.starts_with("report this defect"), "{advice}");
        assert_eq!(guarded(|| panic!("still")), descry_status::DESCRY_ERROR_INTERNAL);
        assert!(remembered()[0].ends_with("got still"));
        assert_eq!(guarded(|| std::panic::panic_any(7)), descry_status::DESCRY_ERROR_INTERNAL);
        assert!(remembered()[0].ends_with("got a panic without words"));
    }

    #[test]
    fn errors_are_of_the_thread_and_stay_after_a_success() {
        assert_eq!(guarded(|| Err(CallError::Null("xyz"))), descry_status::DESCRY_ERROR_ARGUMENT);
        let said = remembered();
        assert_eq!(said[0], "xyz: must point to something, got NULL");
        std::thread::spawn(|| {
            assert_eq!(remembered(), ["", ""]);
            guarded(|| Err(CallError::NoObject));
            assert!(remembered()[0].starts_with("most: "));
        })
        .join()
        .unwrap();
        assert_eq!(guarded(|| Ok(())), descry_status::DESCRY_OK);
        assert_eq!(remembered(), said);
    }
}
