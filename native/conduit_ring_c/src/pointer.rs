//! Pointers as C gives them. Null and misaligned ones are refused; that the others lead to what the header says is the
//! caller's promise, which no function can check.

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

/// # Safety
/// `pointer` is null or leads to a value that nobody changes for `'a`.
pub(crate) unsafe fn shared<'a, T>(pointer: *const T, name: &str) -> Result<&'a T, Failure> {
    check(pointer, name)?;
    // SAFETY: not null, aligned; valid by the caller's promise.
    Ok(unsafe { &*pointer })
}

/// # Safety
/// `pointer` is null or leads to a value that nobody else uses for `'a`.
pub(crate) unsafe fn exclusive<'a, T>(pointer: *mut T, name: &str) -> Result<&'a mut T, Failure> {
    check(pointer, name)?;
    // SAFETY: not null, aligned; valid by the caller's promise.
    Ok(unsafe { &mut *pointer })
}

/// Where a result goes.
pub(crate) struct Out<T>(*mut T);

impl<T> Out<T> {
    /// # Safety
    /// `pointer` is null or valid for writes of a `T` as long as this lives.
    pub(crate) unsafe fn new(pointer: *mut T, name: &str) -> Result<Out<T>, Failure> {
        check(pointer, name)?;
        Ok(Out(pointer))
    }

    pub(crate) fn put(&self, value: T) {
        // SAFETY: checked and promised in `new`.
        unsafe { self.0.write(value) }
    }
}

impl<T> Out<*mut T> {
    /// For a handle: null until there is one, so that C never holds on to rubbish.
    ///
    /// # Safety
    /// As [`Out::new`].
    pub(crate) unsafe fn handle(
        pointer: *mut *mut T,
        name: &str,
        make: impl FnOnce() -> Result<T, Failure>,
    ) -> Result<(), Failure> {
        // SAFETY: the caller's promise is the same.
        let out = unsafe { Out::new(pointer, name) }?;
        out.put(std::ptr::null_mut());
        out.put(Box::into_raw(Box::new(make()?)));
        Ok(())
    }
}

/// # Safety
/// `pointer` is null or came from [`Out::handle`] and is given back for the first time.
pub(crate) unsafe fn give_back<T>(pointer: *mut T) -> Option<T> {
    // SAFETY: made by Box::into_raw, by the caller's promise.
    (!pointer.is_null()).then(|| *unsafe { Box::from_raw(pointer) })
}

/// # Safety
/// `pointer` leads to `len` bytes that nobody changes for `'a`, or `len` is 0, or `pointer` is null.
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
    // SAFETY: not null, not too long; readable by the caller's promise.
    Ok(unsafe { slice::from_raw_parts(pointer.cast(), len) })
}

/// # Safety
/// `pointer` leads to `count` values that nobody changes for `'a`, or `count` is 0, or `pointer` is null.
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
    // SAFETY: not null, aligned, not too long; readable by the caller's promise.
    Ok(unsafe { slice::from_raw_parts(pointer, count) })
}

/// No object is longer, so a longer one is a negative number gone astray.
pub(crate) fn check_len(len: usize, name: &str) -> Result<(), Failure> {
    if isize::try_from(len).is_ok() {
        Ok(())
    } else {
        Err(Failure::invalid(format!(
            "{name} cannot be {len} bytes long"
        )))
    }
}

/// # Safety
/// `pointer` is null or leads to a text that ends with a NUL and that nobody changes for `'a`.
pub(crate) unsafe fn text<'a>(pointer: *const c_char, name: &str) -> Result<&'a str, Failure> {
    check(pointer, name)?;
    // SAFETY: not null; ends with a NUL by the caller's promise.
    let text = unsafe { CStr::from_ptr(pointer) };
    text.to_str()
        .map_err(|_| Failure::invalid(format!("{name} is {text:?}, which is not UTF-8")))
}
