//! What callers pass, as Rust has it: everything that can be told of a pointer is checked before it is followed.

use std::ffi::{CStr, c_char};
use std::path::Path;
use std::slice;

use artefact::{BufferError, MAX_POINTS, cloud_of};
use descriptor::Cloud;

use crate::error::CallError;

/// A pointer that is neither NULL nor misaligned.
fn checked<T>(name: &'static str, pointer: *const T) -> Result<*const T, CallError> {
    if pointer.is_null() {
        return Err(CallError::Null(name));
    }
    if !pointer.is_aligned() {
        let alignment = align_of::<T>();
        return Err(CallError::Misaligned { name, alignment, rest: pointer.addr() % alignment });
    }
    Ok(pointer)
}

/// An object of the caller's.
///
/// # Safety
/// If `pointer` is not refused, it points to a `T` that nobody changes while `'a` lasts.
pub unsafe fn shared<'a, T>(name: &'static str, pointer: *const T) -> Result<&'a T, CallError> {
    // SAFETY: it is not NULL and aligned; the rest is the caller's promise.
    checked(name, pointer).map(|pointer| unsafe { &*pointer })
}

/// An array of the caller's; NULL is one without elements. Its size in bytes must fit an `isize`.
///
/// # Safety
/// If `pointer` is not refused, it points to so many elements that nobody changes while `'a` lasts.
unsafe fn array<'a, T>(name: &'static str, pointer: *const T, length: usize) -> Result<&'a [T], CallError> {
    if length == 0 {
        return Ok(&[]);
    }
    // SAFETY: it is not NULL and aligned; the rest is the caller's promise.
    checked(name, pointer).map(|pointer| unsafe { slice::from_raw_parts(pointer, length) })
}

/// The cloud in arrays of the caller's.
///
/// # Safety
/// `xyz` points to three numbers for each of the points; `rgb`, unless it is NULL, to three bytes; `viewpoint`, unless
/// it is NULL, to three numbers. Nobody changes them during the call.
pub unsafe fn cloud(
    xyz: *const f32,
    rgb: *const u8,
    points: usize,
    viewpoint: *const f32,
) -> Result<Cloud, CallError> {
    if points > MAX_POINTS {
        return Err(BufferError::TooMany(points).into());
    }
    // SAFETY: as the caller promises; three times `MAX_POINTS` fits.
    let (xyz, rgb, viewpoint) = unsafe {
        // Arrays without elements may lie nowhere: that of a cloud without points may be one of colours.
        let has_none = rgb.is_null() && points > 0;
        let rgb = if has_none { None } else { Some(array("rgb", rgb, 3 * points)?) };
        let viewpoint: &[f32] =
            if viewpoint.is_null() { &[0.0; 3] } else { array("viewpoint", viewpoint, 3)? };
        (array("xyz", xyz, 3 * points)?, rgb, viewpoint)
    };
    Ok(cloud_of(xyz, rgb, [viewpoint[0], viewpoint[1], viewpoint[2]])?)
}

/// A path of the caller's.
///
/// # Safety
/// `path`, unless it is NULL, points to a text that ends in NUL and that nobody changes while `'a` lasts.
pub unsafe fn path<'a>(path: *const c_char) -> Result<&'a Path, CallError> {
    // SAFETY: it is not NULL; the rest is the caller's promise.
    let text = unsafe { CStr::from_ptr(checked("path", path)?) };
    if text.is_empty() {
        return Err(CallError::NoPath);
    }
    #[cfg(unix)]
    let path = {
        use std::os::unix::ffi::OsStrExt as _;
        Path::new(std::ffi::OsStr::from_bytes(text.to_bytes()))
    };
    #[cfg(not(unix))]
    let path = Path::new(text.to_str().map_err(|_| CallError::NotUtf8)?);
    Ok(path)
}

/// Where the caller wants a result.
pub struct Place<T>(*mut T);

impl<T> Place<T> {
    /// A place that `empty` is stored in until there is a result.
    ///
    /// # Safety
    /// If `pointer` is not refused, a `T` can be stored there during the call.
    pub unsafe fn new(name: &'static str, pointer: *mut T, empty: T) -> Result<Self, CallError> {
        checked(name, pointer)?;
        let mut place = Self(pointer);
        place.store(empty);
        Ok(place)
    }

    /// As [`Place::new`]; NULL is a place for what nobody wants.
    ///
    /// # Safety
    /// As [`Place::new`].
    pub unsafe fn optional(name: &'static str, pointer: *mut T, empty: T) -> Result<Option<Self>, CallError> {
        // SAFETY: as the caller promises.
        if pointer.is_null() { Ok(None) } else { unsafe { Self::new(name, pointer, empty) }.map(Some) }
    }

    /// Stores the result.
    pub fn store(&mut self, value: T) {
        // SAFETY: `new` has checked the pointer, and its caller promises that it can be written to. What lies there
        // may never have been written: it is not dropped.
        unsafe { self.0.write(value) }
    }
}

/// An array of the caller's that results are stored in.
pub struct Places<T> {
    pointer: *mut T,
    capacity: usize,
}

impl<T: Copy> Places<T> {
    /// NULL has room for nothing.
    ///
    /// # Safety
    /// If `pointer` is not refused, so many elements can be stored there during the call.
    pub unsafe fn new(name: &'static str, pointer: *mut T, capacity: usize) -> Result<Self, CallError> {
        if capacity > 0 {
            checked(name, pointer)?;
        }
        Ok(Self { pointer, capacity })
    }

    /// Whether so many elements fit.
    pub fn check(&self, needed: usize) -> Result<(), CallError> {
        let capacity = self.capacity;
        if needed <= capacity { Ok(()) } else { Err(CallError::Buffer { needed, capacity }) }
    }

    /// Stores elements, if all fit.
    pub fn store(&mut self, elements: impl IntoIterator<Item = T>) -> Result<(), CallError> {
        let elements: Vec<T> = elements.into_iter().collect();
        self.check(elements.len())?;
        if elements.is_empty() {
            return Ok(());
        }
        // SAFETY: `new` has checked the pointer, and its caller promises that `capacity` elements, of which there are
        // no more, can be written to. The vector is the library's own and cannot overlap.
        unsafe { elements.as_ptr().copy_to_nonoverlapping(self.pointer, elements.len()) }
        Ok(())
    }
}
