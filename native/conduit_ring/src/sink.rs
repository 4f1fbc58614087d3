//! Where a message is copied to: a caller's vector, a buffer made for it, or a lease's own copy.

/// A place that gives room for a message once its length is known.
///
/// # Safety
/// `room` returns a pointer that is valid for writes of `len` bytes until it is called again.
pub(crate) unsafe trait Sink {
    /// Gives room for a message of `len` bytes. Called again when a copy was overtaken by the
    /// publisher and another message is tried.
    fn room(&mut self, len: usize) -> *mut u8;
}

/// Copies into a caller's vector, whose capacity is used again and again.
pub(crate) struct IntoVec<'a> {
    buffer: &'a mut Vec<u8>,
}

impl<'a> IntoVec<'a> {
    /// Empties the vector.
    #[inline]
    pub(crate) fn new(buffer: &'a mut Vec<u8>) -> IntoVec<'a> {
        buffer.clear();
        IntoVec { buffer }
    }

    /// Makes the bytes of a message the vector's content.
    ///
    /// # Safety
    /// The last room was asked for at least `len` bytes, and `len` bytes were written there.
    #[inline]
    pub(crate) unsafe fn finish(self, len: usize) {
        // SAFETY: the vector has that room, and its bytes are initialised, by the caller's
        // promise.
        unsafe { self.buffer.set_len(len) };
    }
}

// SAFETY: a vector has as much room as was reserved, until it is touched again.
unsafe impl Sink for IntoVec<'_> {
    #[inline]
    fn room(&mut self, len: usize) -> *mut u8 {
        self.buffer.reserve(len);
        self.buffer.as_mut_ptr()
    }
}

/// Copies into a buffer that a caller's function makes for the message's length.
pub(crate) struct IntoNew<B, F> {
    alloc: F,
    buffer: Option<B>,
}

impl<B, F> IntoNew<B, F> {
    #[inline]
    pub(crate) fn new(alloc: F) -> IntoNew<B, F> {
        IntoNew {
            alloc,
            buffer: None,
        }
    }

    /// Returns the buffer that was made last.
    #[inline]
    pub(crate) fn into_buffer(self) -> Option<B> {
        self.buffer
    }
}

// SAFETY: the slice has the length that was asked for, and its owner stays in place until the
// next call.
unsafe impl<B: AsMut<[u8]>, F: FnMut(usize) -> B> Sink for IntoNew<B, F> {
    fn room(&mut self, len: usize) -> *mut u8 {
        let room = self.buffer.insert((self.alloc)(len)).as_mut();
        assert_eq!(
            room.len(),
            len,
            "expected a buffer as long as the message (right), got one of another length (left)"
        );
        room.as_mut_ptr()
    }
}

/// Copies into a vector of its own, for a lease that is a copy.
#[derive(Default)]
pub(crate) struct IntoBox(Vec<u8>);

impl IntoBox {
    /// Returns the first `len` bytes. A try before the last one may have asked for more.
    pub(crate) fn into_bytes(mut self, len: usize) -> Box<[u8]> {
        self.0.truncate(len);
        self.0.into_boxed_slice()
    }
}

// SAFETY: the vector is at least as long as was asked for, and stays in place until the next
// call.
unsafe impl Sink for IntoBox {
    fn room(&mut self, len: usize) -> *mut u8 {
        if self.0.len() < len {
            self.0.resize(len, 0);
        }
        self.0.as_mut_ptr()
    }
}
