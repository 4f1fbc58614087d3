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
    let mut at = 0;

    while !to.wrapping_add(at).cast::<u64>().is_aligned() && at < len {
        if to.wrapping_add(at).cast::<u32>().is_aligned() && len - at >= HALF {
            // SAFETY: four bytes are left on both sides and the shared side is 4-aligned.
            unsafe { store_half(from.wrapping_add(at), to.wrapping_add(at)) };
            at += HALF;
        } else {
            // SAFETY: a byte is left on both sides.
            unsafe { store_byte(from.wrapping_add(at), to.wrapping_add(at)) };
            at += 1;
        }
    }
    while len - at >= BLOCK {
        for word in 0..BLOCK / WORD {
            let word = at + word * WORD;
            // SAFETY: a whole block is left on both sides and the shared side is 8-aligned.
            unsafe { store_word(from.wrapping_add(word), to.wrapping_add(word)) };
        }
        at += BLOCK;
    }
    while len - at >= WORD {
        // SAFETY: a word is left on both sides and the shared side is 8-aligned.
        unsafe { store_word(from.wrapping_add(at), to.wrapping_add(at)) };
        at += WORD;
    }
    if len - at >= HALF {
        // SAFETY: four bytes are left on both sides and the shared side is 8-aligned.
        unsafe { store_half(from.wrapping_add(at), to.wrapping_add(at)) };
        at += HALF;
    }
    while at < len {
        // SAFETY: a byte is left on both sides.
        unsafe { store_byte(from.wrapping_add(at), to.wrapping_add(at)) };
        at += 1;
    }
}

/// Copies `len` bytes from shared memory into private memory.
///
/// # Safety
/// `from` is valid for reads and `to` for writes of `len` bytes; they do not overlap.
#[inline]
pub(crate) unsafe fn out_of_shared(from: *const u8, to: *mut u8, len: usize) {
    let from = from.cast_mut();
    let mut at = 0;
    while !from.wrapping_add(at).cast::<u64>().is_aligned() && at < len {
        if from.wrapping_add(at).cast::<u32>().is_aligned() && len - at >= HALF {
            // SAFETY: four bytes are left on both sides and the shared side is 4-aligned.
            unsafe { load_half(from.wrapping_add(at), to.wrapping_add(at)) };
            at += HALF;
        } else {
            // SAFETY: a byte is left on both sides.
            unsafe { load_byte(from.wrapping_add(at), to.wrapping_add(at)) };
            at += 1;
        }
    }
    while len - at >= BLOCK {
        for word in 0..BLOCK / WORD {
            let word = at + word * WORD;
            // SAFETY: a whole block is left on both sides and the shared side is 8-aligned.
            unsafe { load_word(from.wrapping_add(word), to.wrapping_add(word)) };
        }
        at += BLOCK;
    }
    while len - at >= WORD {
        // SAFETY: a word is left on both sides and the shared side is 8-aligned.
        unsafe { load_word(from.wrapping_add(at), to.wrapping_add(at)) };
        at += WORD;
    }
    if len - at >= HALF {
        // SAFETY: four bytes are left on both sides and the shared side is 8-aligned.
        unsafe { load_half(from.wrapping_add(at), to.wrapping_add(at)) };
        at += HALF;
    }
    while at < len {
        // SAFETY: a byte is left on both sides.
        unsafe { load_byte(from.wrapping_add(at), to.wrapping_add(at)) };
        at += 1;
    }
}

/// # Safety
/// 8 bytes are readable at `from` and writable at `to`, which is 8-aligned.
#[inline(always)]
unsafe fn store_word(from: *const u8, to: *mut u8) {
    // SAFETY: readable by the caller's promise, of any alignment.
    let value = unsafe { from.cast::<u64>().read_unaligned() };
    // SAFETY: writable and aligned by the caller's promise.
    unsafe { AtomicU64::from_ptr(to.cast()) }.store(value, Relaxed);
}

/// # Safety
/// 8 bytes are readable at `from`, which is 8-aligned, and writable at `to`.
#[inline(always)]
unsafe fn load_word(from: *mut u8, to: *mut u8) {
    // SAFETY: readable and aligned by the caller's promise; a load does not write.
    let value = unsafe { AtomicU64::from_ptr(from.cast()) }.load(Relaxed);
    // SAFETY: writable by the caller's promise, of any alignment.
    unsafe { to.cast::<u64>().write_unaligned(value) };
}

/// # Safety
/// 4 bytes are readable at `from` and writable at `to`, which is 4-aligned.
#[inline(always)]
unsafe fn store_half(from: *const u8, to: *mut u8) {
    // SAFETY: readable by the caller's promise, of any alignment.
    let value = unsafe { from.cast::<u32>().read_unaligned() };
    // SAFETY: writable and aligned by the caller's promise.
    unsafe { AtomicU32::from_ptr(to.cast()) }.store(value, Relaxed);
}

/// # Safety
/// 4 bytes are readable at `from`, which is 4-aligned, and writable at `to`.
#[inline(always)]
unsafe fn load_half(from: *mut u8, to: *mut u8) {
    // SAFETY: readable and aligned by the caller's promise; a load does not write.
    let value = unsafe { AtomicU32::from_ptr(from.cast()) }.load(Relaxed);
    // SAFETY: writable by the caller's promise, of any alignment.
    unsafe { to.cast::<u32>().write_unaligned(value) };
}

/// # Safety
/// A byte is readable at `from` and writable at `to`.
#[inline(always)]
unsafe fn store_byte(from: *const u8, to: *mut u8) {
    // SAFETY: readable by the caller's promise.
    let value = unsafe { from.read() };
    // SAFETY: writable by the caller's promise.
    unsafe { AtomicU8::from_ptr(to) }.store(value, Relaxed);
}

/// # Safety
/// A byte is readable at `from` and writable at `to`.
#[inline(always)]
unsafe fn load_byte(from: *mut u8, to: *mut u8) {
    // SAFETY: readable by the caller's promise; a load does not write.
    let value = unsafe { AtomicU8::from_ptr(from) }.load(Relaxed);
    // SAFETY: writable by the caller's promise.
    unsafe { to.write(value) };
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
