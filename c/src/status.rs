//! What calls return: a number, and its name.

use std::ffi::CStr;

/// What a call has come to.
#[allow(non_camel_case_types, reason = "names of C")]
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum descry_status {
    /// All is well.
    DESCRY_OK = 0,
    /// An argument that nothing can be done with: NULL, misaligned, too large; or such an environment variable.
    DESCRY_ERROR_ARGUMENT = 1,
    /// The array is too small. How many elements it needs has been stored, and nothing else.
    DESCRY_ERROR_BUFFER = 2,
    /// A file of the artefact cannot be read.
    DESCRY_ERROR_READ = 3,
    /// The artefact is damaged, was changed by hand, or is something else.
    DESCRY_ERROR_ARTEFACT = 4,
    /// The artefact is of a release that computes other numbers.
    DESCRY_ERROR_VERSION = 5,
    /// The cloud cannot be described, for example because it shows too little of the object.
    DESCRY_ERROR_CLOUD = 6,
    /// A defect of the library. The recogniser can be freed, but should no longer be asked.
    DESCRY_ERROR_INTERNAL = 7,
}

/// The name of a status, as C has it.
pub fn name(status: i32) -> &'static CStr {
    use descry_status::*;
    match status {
        _ if status == DESCRY_OK as i32 => c"DESCRY_OK",
        _ if status == DESCRY_ERROR_ARGUMENT as i32 => c"DESCRY_ERROR_ARGUMENT",
        _ if status == DESCRY_ERROR_BUFFER as i32 => c"DESCRY_ERROR_BUFFER",
        _ if status == DESCRY_ERROR_READ as i32 => c"DESCRY_ERROR_READ",
        _ if status == DESCRY_ERROR_ARTEFACT as i32 => c"DESCRY_ERROR_ARTEFACT",
        _ if status == DESCRY_ERROR_VERSION as i32 => c"DESCRY_ERROR_VERSION",
        _ if status == DESCRY_ERROR_CLOUD as i32 => c"DESCRY_ERROR_CLOUD",
        _ if status == DESCRY_ERROR_INTERNAL as i32 => c"DESCRY_ERROR_INTERNAL",
        _ => c"unknown status",
    }
}
