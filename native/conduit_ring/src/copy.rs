//! Copying into and out of memory that another process may be writing.
//!
//! `memcpy` there would be a data race, which is undefined behaviour. These copies use relaxed
//! atomics, in words of eight bytes where the shared side is aligned. A copy may mix old and new
//! words but is always defined, and the protocol around it rejects the mixture. The private side
//! may have any alignment.
//!
//! ```text
//!   shared side  ├─1─┼──4──┼────8────┼── 64 ──┼── 64 ──┼ … ┼──8──┼─4─┼1┼1┤
//!                 until 8-aligned      blocks of 8 words     the rest
//! ```

use core::sync::atomic::{AtomicU8, AtomicU32, AtomicU64, Ordering::Relaxed};

const HALF: usize = 4;
const WORD: usize = 8;
const BLOCK: usize = 8 * WORD;

/// Copies `len` bytes from private memory into shared memory.
///
/// # Safety
/// `from` is valid for reads and `to` for writes of `len` bytes; they do not overlap.
#[inline]
pub(crate) unsafe fn into_shared(from: *const u8, to: *mut u8, len: usize) {
    for_each_piece(to, len, |piece, at| {
        let (from, to) = (from.wrapping_add(at), to.wrapping_add(at));
        match piece {
            // SAFETY: the piece lies inside both sides, and the shared side is 8-aligned there.
            Piece::Word => unsafe { store::<AtomicU64>(from, to) },
            // SAFETY: the piece lies inside both sides, and the shared side is 4-aligned there.
            Piece::Half => unsafe { store::<AtomicU32>(from, to) },
            // SAFETY: the piece lies inside both sides.
            Piece::Byte => unsafe { store::<AtomicU8>(from, to) },
        }
    });
}

/// Copies `len` bytes from shared memory into private memory.
///
/// # Safety
/// `from` is valid for reads and `to` for writes of `len` bytes; they do not overlap.
#[inline]
pub(crate) unsafe fn out_of_shared(from: *const u8, to: *mut u8, len: usize) {
    for_each_piece(from, len, |piece, at| {
        let (from, to) = (from.wrapping_add(at).cast_mut(), to.wrapping_add(at));
        match piece {
            // SAFETY: the piece lies inside both sides, and the shared side is 8-aligned there.
            Piece::Word => unsafe { load::<AtomicU64>(from, to) },
            // SAFETY: the piece lies inside both sides, and the shared side is 4-aligned there.
            Piece::Half => unsafe { load::<AtomicU32>(from, to) },
            // SAFETY: the piece lies inside both sides.
            Piece::Byte => unsafe { load::<AtomicU8>(from, to) },
        }
    });
}

/// A part of a copy that one access makes.
#[derive(Clone, Copy)]
enum Piece {
    Byte,
    Half,
    Word,
}

/// Cuts `len` bytes at `shared` into pieces that are aligned there, and calls `copy` with each
/// and its offset. The pieces follow each other without a gap.
#[inline(always)]
fn for_each_piece(shared: *const u8, len: usize, mut copy: impl FnMut(Piece, usize)) {
    let mut at = 0;
    while !shared.wrapping_add(at).cast::<u64>().is_aligned() && at < len {
        if shared.wrapping_add(at).cast::<u32>().is_aligned() && len - at >= HALF {
            copy(Piece::Half, at);
            at += HALF;
        } else {
            copy(Piece::Byte, at);
            at += 1;
        }
    }
    while len - at >= BLOCK {
        for word in 0..BLOCK / WORD {
            copy(Piece::Word, at + word * WORD);
        }
        at += BLOCK;
    }
    while len - at >= WORD {
        copy(Piece::Word, at);
        at += WORD;
    }
    if len - at >= HALF {
        copy(Piece::Half, at);
        at += HALF;
    }
    while at < len {
        copy(Piece::Byte, at);
        at += 1;
    }
}

/// An atomic type of the shared side.
trait Atomic {
    type Value: Copy;

    /// # Safety
    /// `address` is valid for reads and writes of a value, and aligned, for `'a`.
    unsafe fn at<'a>(address: *mut u8) -> &'a Self;
    fn get(&self) -> Self::Value;
    fn set(&self, value: Self::Value);
}

macro_rules! atomic {
    ($atomic:ty, $value:ty) => {
        impl Atomic for $atomic {
            type Value = $value;

            #[inline(always)]
            unsafe fn at<'a>(address: *mut u8) -> &'a Self {
                // SAFETY: valid and aligned by the caller's promise.
                unsafe { <$atomic>::from_ptr(address.cast()) }
            }

            #[inline(always)]
            fn get(&self) -> $value {
                // Relaxed: the fences of reader and writer order whole copies.
                self.load(Relaxed)
            }

            #[inline(always)]
            fn set(&self, value: $value) {
                // Relaxed: as in get.
                self.store(value, Relaxed);
            }
        }
    };
}

atomic!(AtomicU8, u8);
atomic!(AtomicU32, u32);
atomic!(AtomicU64, u64);

/// # Safety
/// A value is readable at `from` and writable at `to`, which is aligned.
#[inline(always)]
unsafe fn store<A: Atomic>(from: *const u8, to: *mut u8) {
    // SAFETY: readable by the caller's promise, of any alignment.
    let value = unsafe { from.cast::<A::Value>().read_unaligned() };
    // SAFETY: writable and aligned by the caller's promise.
    unsafe { A::at(to) }.set(value);
}

/// # Safety
/// A value is readable at `from`, which is aligned, and writable at `to`.
#[inline(always)]
unsafe fn load<A: Atomic>(from: *mut u8, to: *mut u8) {
    // SAFETY: readable and aligned by the caller's promise; a load does not write.
    let value = unsafe { A::at(from) }.get();
    // SAFETY: writable by the caller's promise, of any alignment.
    unsafe { to.cast::<A::Value>().write_unaligned(value) };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_length_at_every_alignment_arrives_whole_and_touches_nothing_else() {
        let source: Vec<u8> = (0..=255).cycle().take(400).collect();
        // Miri is a thousand times slower, and finds a fault at any of them.
        let (step, longer) = if cfg!(miri) { (4, 16) } else { (1, 1) };
        for shared_at in (0..9).step_by(step) {
            for private_at in (0..9).step_by(step) {
                for len in (0..=140).step_by(longer).chain([255, 256, 257, 333]) {
                    let private = &source[private_at..private_at + len];
                    let mut shared = [0xAA_u8; 400];
                    // SAFETY: both sides have `len` bytes: 8 + 333 < 400.
                    unsafe {
                        into_shared(
                            private.as_ptr(),
                            shared.as_mut_ptr().wrapping_add(shared_at),
                            len,
                        )
                    };
                    assert_eq!(&shared[shared_at..shared_at + len], private);
                    assert!(
                        shared[..shared_at]
                            .iter()
                            .chain(&shared[shared_at + len..])
                            .all(|b| *b == 0xAA)
                    );

                    let mut back = [0x55_u8; 400];
                    // SAFETY: both sides have `len` bytes.
                    unsafe {
                        out_of_shared(
                            shared.as_mut_ptr().wrapping_add(shared_at),
                            back.as_mut_ptr().wrapping_add(private_at),
                            len,
                        );
                    };
                    assert_eq!(&back[private_at..private_at + len], private);
                    assert!(
                        back[..private_at]
                            .iter()
                            .chain(&back[private_at + len..])
                            .all(|b| *b == 0x55)
                    );
                }
            }
        }
    }
}
