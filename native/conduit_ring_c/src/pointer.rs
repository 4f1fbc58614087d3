//! Checks of pointers from C. Null and misaligned pointers are errors. For all others the caller
//! guarantees what the header demands, which no function can check.

use std::ffi::{CStr, c_char, c_void};
use std::slice;

use crate::failure::Failure;

fn check<T>(pointer: *const T, name: &str) -> Result<(), Failure> {
    if pointer.is_null() {
        Err(Failure::invalid(format!("{name} is NULL")))
    } else if !pointer.is_aligned() {
        Err(Failure::invalid(format!("{name} is not aligned")))
    } else {
        Ok(())
    }
}

/// Borrows the value behind a pointer.
///
/// # Safety
/// `pointer` is null or points to a value that no thread changes for `'a`.
pub(crate) unsafe fn shared<'a, T>(pointer: *const T, name: &str) -> Result<&'a T, Failure> {
    check(pointer, name)?;
    // SAFETY: not null and aligned; the caller guarantees the rest.
    Ok(unsafe { &*pointer })
}

/// Borrows the value behind a pointer mutably.
///
/// # Safety
/// `pointer` is null or points to a value that no other thread uses for `'a`.
pub(crate) unsafe fn exclusive<'a, T>(pointer: *mut T, name: &str) -> Result<&'a mut T, Failure> {
    check(pointer, name)?;
    // SAFETY: not null and aligned; the caller guarantees the rest.
    Ok(unsafe { &mut *pointer })
}

/// The destination of a result.
pub(crate) struct Out<T>(*mut T);

impl<T> Out<T> {
    /// Checks the pointer to a destination.
    ///
    /// # Safety
    /// `pointer` is null or valid for writes of a `T` for as long as the result exists.
    pub(crate) unsafe fn new(pointer: *mut T, name: &str) -> Result<Out<T>, Failure> {
        check(pointer, name)?;
        Ok(Out(pointer))
    }

    pub(crate) fn put(&self, value: T) {
        // SAFETY: `new` has checked the pointer, and its caller guarantees the rest.
        unsafe { self.0.write(value) }
    }
}

impl<T> Out<*mut T> {
    /// Writes the handle that `create` returns. Writes null first, so that the caller has no
    /// invalid handle after an error.
    ///
    /// # Safety
    /// As [`Out::new`].
    pub(crate) unsafe fn handle(
        pointer: *mut *mut T,
        name: &str,
        create: impl FnOnce() -> Result<T, Failure>,
    ) -> Result<(), Failure> {
        // SAFETY: the caller guarantees the same.
        let out = unsafe { Out::new(pointer, name) }?;
        out.put(std::ptr::null_mut());
        out.put(Box::into_raw(Box::new(create()?)));
        Ok(())
    }
}

/// Takes ownership of a handle back.
///
/// # Safety
/// `pointer` is null, or came from [`Out::handle`] and was not taken before.
pub(crate) unsafe fn take<T>(pointer: *mut T) -> Option<T> {
    // SAFETY: the pointer came from Box::into_raw, as the caller guarantees.
    (!pointer.is_null()).then(|| *unsafe { Box::from_raw(pointer) })
}

/// Borrows bytes.
///
/// # Safety
/// `pointer` points to `len` bytes that no thread changes for `'a`, or `len` is 0, or `pointer`
/// is null.
pub(crate) unsafe fn bytes<'a>(
    pointer: *const c_void,
    len: usize,
    name: &str,
) -> Result<&'a [u8], Failure> {
    if len == 0 {
        return Ok(&[]);
    }
    check(pointer.cast::<u8>(), name)?;
    check_len(len, name)?;
    // SAFETY: not null and not too long; the caller guarantees that the bytes are readable.
    Ok(unsafe { slice::from_raw_parts(pointer.cast(), len) })
}

/// Borrows an array.
///
/// # Safety
/// `pointer` points to `count` values that no thread changes for `'a`, or `count` is 0, or
/// `pointer` is null.
pub(crate) unsafe fn array<'a, T>(
    pointer: *const T,
    count: usize,
    name: &str,
) -> Result<&'a [T], Failure> {
    if count == 0 {
        return Ok(&[]);
    }
    check(pointer, name)?;
    check_len(count.saturating_mul(size_of::<T>()), name)?;
    // SAFETY: not null, aligned and not too long; the caller guarantees that the values are
    // readable.
    Ok(unsafe { slice::from_raw_parts(pointer, count) })
}

/// Checks a length. No object is longer than `isize::MAX`; such a length is a converted negative
/// number.
pub(crate) fn check_len(len: usize, name: &str) -> Result<(), Failure> {
    if isize::try_from(len).is_ok() {
        Ok(())
    } else {
        Err(Failure::invalid(format!(
            "invalid size of {name}: expected at most {} bytes, got: {len}",
            isize::MAX
        )))
    }
}

/// Borrows a text.
///
/// # Safety
/// `pointer` is null or points to a NUL-terminated text that no thread changes for `'a`.
pub(crate) unsafe fn text<'a>(pointer: *const c_char, name: &str) -> Result<&'a str, Failure> {
    check(pointer, name)?;
    // SAFETY: not null; the caller guarantees that a NUL ends the text.
    let text = unsafe { CStr::from_ptr(pointer) };
    text.to_str()
        .map_err(|_| Failure::invalid(format!("invalid {name}: expected UTF-8, got: {text:?}")))
}
