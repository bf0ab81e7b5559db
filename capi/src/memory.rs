//! Arguments that C passes by pointer: structures that state their size, arrays, strings, and output pointers.

use crate::result::{Failure, Result, ensure};
use std::ffi::{CStr, c_char};

/// A structure that begins with its size in bytes, so that it can get further fields at its end.
///
/// # Safety
/// `repr(C)`, without padding; the first field is a `u32`; any bytes are a valid value, and all zeros are the defaults.
pub unsafe trait Versioned: Copy {
    /// Its name in C.
    const NAME: &'static str;

    /// Its size in bytes in the first version of the API.
    const FIRST_SIZE: usize = size_of::<Self>();

    /// Its reserved field, which has to be zero, so that it can get a meaning later.
    fn reserved(&self) -> u32 {
        0
    }

    /// All zeros but the size.
    fn zeroed() -> Self {
        // SAFETY: all zeros are a value, and the first field is a `u32`, says the trait.
        unsafe {
            let mut value: Self = std::mem::zeroed();
            (&raw mut value).cast::<u32>().write_unaligned(size_of::<Self>() as u32);
            value
        }
    }
}

/// Reads the size that the structure at `pointer` states.
///
/// # Safety
/// `pointer` is null, or points to memory that begins with a `u32`.
unsafe fn stated_size<T: Versioned>(pointer: *const T) -> Result<usize> {
    ensure!(!pointer.is_null(), "a null pointer to {0}; hand in a {0}", T::NAME);
    // SAFETY: the caller's obligation.
    let size = unsafe { pointer.cast::<u32>().read_unaligned() } as usize;
    ensure!(
        size >= T::FIRST_SIZE,
        "{0} with a struct_size of {size}; set it to sizeof({0}), which is at least {1}",
        T::NAME,
        T::FIRST_SIZE
    );
    Ok(size)
}

/// Reads a structure of the caller's: fields that an earlier version did not have are zero; non-zero bytes of a later
/// version are refused.
///
/// # Safety
/// `pointer` is null, or points at as many readable bytes as the structure states in its first four.
pub unsafe fn read<T: Versioned>(pointer: *const T) -> Result<T> {
    // SAFETY: the caller's obligation.
    let size = unsafe { stated_size(pointer) }?;
    let known = size.min(size_of::<T>());
    let mut value = T::zeroed();
    // SAFETY: `known` bytes can be read there, and written to `value`, of which any bytes are a value.
    let rest = unsafe {
        pointer.cast::<u8>().copy_to_nonoverlapping((&raw mut value).cast(), known);
        std::slice::from_raw_parts(pointer.cast::<u8>().add(known), size - known)
    };
    ensure!(
        rest.iter().all(|byte| *byte == 0),
        "{0} of {size} bytes, of which this version of the library knows {known}, and something is set behind \
         them; link a library that is as new as the header, or leave the rest zero",
        T::NAME
    );
    let reserved = value.reserved();
    ensure!(reserved == 0, "{}: 'reserved' is {reserved}; set it to 0", T::NAME);
    Ok(value)
}

/// [`read`] with the defaults for a null pointer.
///
/// # Safety
/// The conditions of [`read`].
pub unsafe fn read_or_default<T: Versioned>(pointer: *const T) -> Result<T> {
    // SAFETY: the caller's obligation.
    if pointer.is_null() { Ok(T::zeroed()) } else { unsafe { read(pointer) } }
}

/// Reads `count` consecutive structures of the caller's, each as long as it states.
///
/// # Safety
/// The conditions of [`read`], for each.
pub unsafe fn array<T: Versioned>(first: *const T, count: u32) -> Result<Vec<T>> {
    let mut all = vec![];
    let mut next = first;
    for _ in 0..count {
        // SAFETY: the caller's obligation.
        unsafe {
            all.push(read(next)?);
            next = next.byte_add(stated_size(next)?);
        }
    }
    Ok(all)
}

/// A pointer of the caller's to a structure for a result, which states its size.
pub struct Place<T> {
    pointer: *mut T,
    size: usize,
}

impl<T: Versioned> Place<T> {
    /// Checks the pointer, before anything is done.
    ///
    /// # Safety
    /// `pointer` is null, or points at as many bytes as the structure states in its first four, which can be written
    /// until the value is used.
    pub unsafe fn new(pointer: *mut T) -> Result<Self> {
        // SAFETY: the caller's obligation.
        Ok(Self { pointer, size: unsafe { stated_size(pointer) }? })
    }

    /// [`new`](Self::new), or `None` for a null pointer: the caller wants no result.
    ///
    /// # Safety
    /// The conditions of [`new`](Self::new).
    pub unsafe fn new_or_null(pointer: *mut T) -> Result<Option<Self>> {
        // SAFETY: the caller's obligation.
        if pointer.is_null() { Ok(None) } else { unsafe { Self::new(pointer) }.map(Some) }
    }

    /// The pointer to the next structure of an array.
    ///
    /// # Safety
    /// There is one.
    pub unsafe fn next(&self) -> *mut T {
        // SAFETY: the caller's obligation.
        unsafe { self.pointer.byte_add(self.size) }
    }

    /// Writes the fields that caller and library both know, and zeroes those that only the caller knows. The size
    /// stays.
    pub fn write(self, value: T) {
        let size = size_of::<u32>();
        let known = self.size.min(size_of::<T>());
        // SAFETY: as many bytes can be written there, says `new`; the value has `known`, and a `u32` comes first.
        unsafe {
            let to = self.pointer.cast::<u8>();
            let from = (&raw const value).cast::<u8>();
            to.add(size).copy_from_nonoverlapping(from.add(size), known - size);
            to.add(known).write_bytes(0, self.size - known);
        }
    }
}

/// Checks an output pointer, before anything is done.
pub fn check_place<T>(pointer: *const T, what: &str) -> Result<()> {
    check_pointer(pointer, what, "hand in where to write the result")
}

fn check_pointer<T>(pointer: *const T, what: &str, remedy: &str) -> Result<()> {
    ensure!(!pointer.is_null(), "'{what}' is a null pointer; {remedy}");
    let align = align_of::<T>();
    ensure!(pointer.is_aligned(), "'{what}' is at {pointer:p}, which is no multiple of {align}; align it");
    Ok(())
}

/// An array of the caller's; `what` names it in messages.
///
/// # Safety
/// `pointer` is null, or points at `count` elements, which are not written while the slice is used.
pub unsafe fn slice<'a, T>(pointer: *const T, count: usize, what: &str) -> Result<&'a [T]> {
    if count == 0 {
        return Ok(&[]);
    }
    check_array(pointer, count, what)?;
    // SAFETY: not null, aligned, no larger than memory, and the caller's obligations.
    Ok(unsafe { std::slice::from_raw_parts(pointer, count) })
}

fn check_array<T>(pointer: *const T, count: usize, what: &str) -> Result<()> {
    check_pointer(pointer, what, &format!("hand in {count} elements, or a count of 0"))?;
    let most = isize::MAX as usize / size_of::<T>().max(1);
    ensure!(count <= most, "'{what}' has {count} elements, more than there is memory for");
    Ok(())
}

/// Writes `values` to an array of the caller's with room for `count`.
///
/// # Safety
/// `pointer` is null, or points at room for `count` elements.
pub unsafe fn fill<T: Copy>(pointer: *mut T, count: usize, values: &[T], what: &str) -> Result<()> {
    if values.is_empty() {
        return Ok(());
    }
    check_place(pointer, what)?;
    let needed = values.len();
    ensure!(count >= needed, "'{what}' has room for {count} elements, and {needed} are needed; give {needed}");
    // SAFETY: there is room for `count`, says the caller, and that is enough.
    unsafe { pointer.copy_from_nonoverlapping(values.as_ptr(), values.len()) };
    Ok(())
}

/// Answers a list query: if `items` is null, with its length; otherwise with the items, for which `count` is the room.
///
/// # Safety
/// `count` is null, or points at a number; `items` is null, or points at room for that many.
pub unsafe fn list<T: Copy>(count: *mut u32, items: *mut T, values: &[T], what: &str) -> Result<()> {
    check_place(count, "count")?;
    // SAFETY: the caller's obligations; `count` was checked.
    unsafe {
        if !items.is_null() {
            fill(items, *count as usize, values, what)?;
        }
        *count = values.len() as u32;
    }
    Ok(())
}

/// The beginning of a text, ended by a zero.
pub fn characters<const N: usize>(text: &str) -> [c_char; N] {
    let mut all = [0; N];
    all[..N - 1].iter_mut().zip(text.bytes()).for_each(|(to, from)| *to = from.cast_signed() as _);
    all
}

/// A string of the caller's; `what` names it in messages.
///
/// # Safety
/// `pointer` is null, or points at a string ended by a zero, which is not written while it is used.
pub unsafe fn text<'a>(pointer: *const c_char, what: &str) -> Result<&'a str> {
    check_pointer(pointer, what, "hand in a string")?;
    // SAFETY: the caller's obligation.
    let text = unsafe { CStr::from_ptr(pointer) };
    text.to_str().map_err(|error| Failure::invalid(format!("'{what}' is no UTF-8 ({error}); convert it")))
}

/// [`text`], or an empty string for a null pointer.
///
/// # Safety
/// The conditions of [`text`].
pub unsafe fn text_or_empty<'a>(pointer: *const c_char, what: &str) -> Result<&'a str> {
    // SAFETY: the caller's obligation.
    if pointer.is_null() { Ok("") } else { unsafe { text(pointer, what) } }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A structure that has got a field since the first version.
    #[repr(C)]
    #[derive(Clone, Copy, Debug, PartialEq)]
    struct Grown {
        size: u32,
        old: u32,
        new: u32,
    }

    // SAFETY: three numbers, the size first.
    unsafe impl Versioned for Grown {
        const NAME: &'static str = "Grown";
        const FIRST_SIZE: usize = 8;
    }

    fn message<T>(result: Result<T>) -> String {
        result.err().map(|failure| failure.message).unwrap_or_default()
    }

    #[test]
    fn structures_of_earlier_and_later_versions_are_read() {
        // SAFETY: each array has as many bytes as it says.
        let read = |words: &[u32]| unsafe { super::read(words.as_ptr().cast::<Grown>()) };
        assert_eq!(read(&[8, 5]).unwrap(), Grown { size: 8, old: 5, new: 0 });
        assert_eq!(read(&[12, 5, 6]).unwrap(), Grown { size: 12, old: 5, new: 6 });
        assert_eq!(read(&[20, 5, 6, 0, 0]).unwrap(), Grown { size: 20, old: 5, new: 6 });
        assert!(message(read(&[20, 5, 6, 0, 1])).contains("Grown of 20 bytes, of which this version"));
        for size in [0, 4, 7] {
            assert!(message(read(&[size, 5])).contains("set it to sizeof(Grown), which is at least 8"));
        }
        // SAFETY: null is allowed.
        let default = unsafe { (super::read::<Grown>(std::ptr::null()), read_or_default::<Grown>(std::ptr::null())) };
        assert!(message(default.0).contains("a null pointer to Grown"));
        assert_eq!(default.1.unwrap(), Grown { size: 12, old: 0, new: 0 });
    }

    #[test]
    fn results_fit_what_the_caller_knows_and_its_size_stays() {
        let value = Grown { size: 12, old: 5, new: 6 };
        for (mut words, written) in [
            (vec![8, 1, 1], vec![8, 5, 1]),
            (vec![12, 1, 1], vec![12, 5, 6]),
            (vec![16, 1, 1, 1, 1], vec![16, 5, 6, 0, 1]),
        ] {
            // SAFETY: each array has as many bytes as it says.
            unsafe { Place::new(words.as_mut_ptr().cast::<Grown>()) }.unwrap().write(value);
            assert_eq!(words, written);
        }
    }
}
