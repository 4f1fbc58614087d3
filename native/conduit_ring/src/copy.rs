//! Copying into and out of memory that another process may be writing.
//!
//! `memcpy` there would be a data race. These copies use relaxed atomics, in words of eight bytes where the shared side
//! is aligned, so a copy may mix old and new words but is never undefined; the protocol around it rejects the mixture.
//! The private side may have any alignment.

use core::sync::atomic::{AtomicU8, AtomicU32, AtomicU64, Ordering::Relaxed};

const WORD: usize = 8;
const BLOCK: usize = 8 * WORD;

/// Copies `len` bytes from private memory into shared memory.
///
/// # Safety
/// `from` is valid for reads and `to` for writes of `len` bytes; they do not overlap.
#[inline]
pub(crate) unsafe fn into_shared(from: *const u8, to: *mut u8, len: usize) {
    let mut at = 0;
    while at < len {
        let shared = to.wrapping_add(at);
        let private = from.wrapping_add(at);
        let left = len - at;
        let aligned = shared.addr() % WORD == 0;
        at += if aligned && left >= BLOCK {
            let blocks = left / BLOCK;
            // SAFETY: `blocks` whole blocks are left on both sides and the shared side is 8-aligned.
            unsafe { store_blocks(private, shared, blocks) };
            blocks * BLOCK
        } else if aligned && left >= WORD {
            // SAFETY: a word is left on both sides and the shared side is 8-aligned.
            unsafe { store_word(private, shared) };
            WORD
        } else if shared.addr() % 4 == 0 && left >= 4 {
            // SAFETY: four bytes are left on both sides and the shared side is 4-aligned.
            unsafe { store_half(private, shared) };
            4
        } else {
            // SAFETY: a byte is left on both sides.
            unsafe { store_byte(private, shared) };
            1
        };
    }
}

/// Copies `len` bytes from shared memory into private memory.
///
/// # Safety
/// `from` is valid for reads and `to` for writes of `len` bytes; they do not overlap.
#[inline]
pub(crate) unsafe fn out_of_shared(from: *const u8, to: *mut u8, len: usize) {
    let mut at = 0;
    while at < len {
        let shared = from.wrapping_add(at).cast_mut();
        let private = to.wrapping_add(at);
        let left = len - at;
        let aligned = shared.addr() % WORD == 0;
        at += if aligned && left >= BLOCK {
            let blocks = left / BLOCK;
            // SAFETY: `blocks` whole blocks are left on both sides and the shared side is 8-aligned.
            unsafe { load_blocks(shared, private, blocks) };
            blocks * BLOCK
        } else if aligned && left >= WORD {
            // SAFETY: a word is left on both sides and the shared side is 8-aligned.
            unsafe { load_word(shared, private) };
            WORD
        } else if shared.addr() % 4 == 0 && left >= 4 {
            // SAFETY: four bytes are left on both sides and the shared side is 4-aligned.
            unsafe { load_half(shared, private) };
            4
        } else {
            // SAFETY: a byte is left on both sides.
            unsafe { load_byte(shared, private) };
            1
        };
    }
}

/// # Safety
/// `blocks` blocks are readable at `from` and writable at `to`, which is 8-aligned.
unsafe fn store_blocks(from: *const u8, to: *mut u8, blocks: usize) {
    for block in 0..blocks {
        let (from, to) = (
            from.wrapping_add(block * BLOCK),
            to.wrapping_add(block * BLOCK),
        );
        for word in 0..BLOCK / WORD {
            // SAFETY: word `word` of block `block` lies inside by the caller's promise.
            unsafe { store_word(from.wrapping_add(word * WORD), to.wrapping_add(word * WORD)) };
        }
    }
}

/// # Safety
/// `blocks` blocks are readable at `from`, which is 8-aligned, and writable at `to`.
unsafe fn load_blocks(from: *mut u8, to: *mut u8, blocks: usize) {
    for block in 0..blocks {
        let (from, to) = (
            from.wrapping_add(block * BLOCK),
            to.wrapping_add(block * BLOCK),
        );
        for word in 0..BLOCK / WORD {
            // SAFETY: word `word` of block `block` lies inside by the caller's promise.
            unsafe { load_word(from.wrapping_add(word * WORD), to.wrapping_add(word * WORD)) };
        }
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
        for shared_at in 0..9 {
            for private_at in 0..9 {
                for len in (0..=140).chain([255, 256, 257, 333]) {
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
                            shared.as_ptr().wrapping_add(shared_at),
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
