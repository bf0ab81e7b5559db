//! Accessors: arrays of numbers of any component type, normalised or not, with any stride; dense, sparse or all zero.

use super::container::Container;
use super::json::At;
use crate::error::{Result, ensure};

/// An array of elements of `components` numbers each.
#[derive(Debug)]
pub struct Accessor<'a> {
    file: &'a Container,
    pub at: At<'a>,
    pub count: usize,
    pub components: usize,
    kind: Kind,
    /// Integers are fractions of the largest one.
    normalised: bool,
    /// Bytes from the first element on, and the stride of elements. `None`: zeros.
    dense: Option<(&'a [u8], usize)>,
    /// Elements with other values: their indices, ascending; their bytes from the first one on; and the stride.
    sparse: (Vec<u32>, &'a [u8], usize),
    /// The number in place of those of an element that is not finite; `None`: such an element is an error.
    missing: Option<f32>,
    /// Elements may have fewer numbers than are read; the others are 0.
    is_padded: bool,
}

/// A component type: its bytes, and what they are.
#[derive(Clone, Copy, Debug)]
struct Kind {
    size: usize,
    is_unsigned: bool,
}

impl Kind {
    fn of(at: &At<'_>) -> Result<Self> {
        let (size, is_unsigned) = match at.whole()? {
            5120 => (1, false),
            5121 => (1, true),
            5122 => (2, false),
            5123 => (2, true),
            5125 => (4, true),
            5126 => (4, false),
            n => return Err(at.refuse(format!("{n} is no component type of glTF 2.0"), "export the file again")),
        };
        Ok(Self { size, is_unsigned })
    }

    fn whole(self, b: &[u8]) -> i64 {
        let mut word = [0; 8];
        word[..self.size].copy_from_slice(&b[..self.size]);
        // Widened, with its sign if it has one.
        let word = i64::from_le_bytes(word);
        let bits = 64 - 8 * self.size;
        if self.is_unsigned { word } else { word << bits >> bits }
    }

    fn is_float(self) -> bool {
        // There are no signed integers of four bytes.
        self.size == 4 && !self.is_unsigned
    }

    /// Reads an index, of whatever type it is; `None` if it is no whole number, 0 or more.
    fn index(self, b: &[u8]) -> Option<u32> {
        let number = if self.is_float() { f64::from(self.number(b, false)) } else { self.whole(b) as f64 };
        let is_index = number.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&number);
        is_index.then_some(number as u32)
    }

    /// Reads the number at the start of `b`. Normalised integers are fractions of the largest one, at least -1.
    fn number(self, b: &[u8], normalised: bool) -> f32 {
        if self.is_float() {
            return f32::from_le_bytes([b[0], b[1], b[2], b[3]]);
        }
        let bits = 8 * self.size - usize::from(!self.is_unsigned);
        let largest = ((1u64 << bits) - 1) as f64;
        let whole = self.whole(b) as f64;
        if normalised { (whole / largest).max(-1.0) as f32 } else { whole as f32 }
    }
}

impl Container {
    /// Returns the accessor that `index` names.
    pub fn accessor(&self, index: &At<'_>) -> Result<Accessor<'_>> {
        let at = self.root().item("accessors", index)?;
        let kind = Kind::of(&at.need("componentType")?)?;
        let count = at.need("count")?.whole()?;
        let remedy = "export the file again: 4,294,967,295 are the most";
        ensure!(u32::try_from(count).is_ok(), at.refuse(format!("{count} elements"), remedy));
        let shape = at.need("type")?;
        let components = match shape.text()? {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            "MAT4" => 16,
            other => return Err(shape.refuse(format!("type '{other}', which meshes and animations do not use"), UNFIT)),
        };
        let element = kind.size * components;
        // An empty accessor has no bytes to look for.
        let dense =
            at.get("bufferView").filter(|_| count > 0).map(|_| self.elements(&at, count, element)).transpose()?;
        let sparse = at.get("sparse").filter(|_| count > 0).map(|sparse| self.sparse(&sparse, count, element));
        Ok(Accessor {
            count,
            components,
            kind,
            normalised: at.flag("normalized"),
            dense,
            sparse: sparse.transpose()?.unwrap_or_default(),
            missing: None,
            is_padded: false,
            file: self,
            at,
        })
    }

    /// The bytes of the buffer view that `at` names, from the first of `count` elements on, and their stride.
    fn elements(&self, at: &At<'_>, count: usize, element: usize) -> Result<(&[u8], usize)> {
        let (bytes, stride) = self.view(&at.need("bufferView")?)?;
        let offset = at.whole_or("byteOffset", 0)?;
        let stride = stride.unwrap_or(element);
        let end = (count - 1).checked_mul(stride).and_then(|n| n.checked_add(element)?.checked_add(offset));
        let fits = end.is_some_and(|end| end <= bytes.len());
        let what = format!("{count} elements of {element} bytes every {stride} bytes from byte {offset} on");
        let what = format!("{what}, but the buffer view has {} bytes", bytes.len());
        ensure!(fits, at.refuse(what, "export the file again: it is cut off, or a count is wrong"));
        Ok((&bytes[offset..], stride))
    }

    /// The indices of elements with other values, their bytes and stride.
    fn sparse(&self, at: &At<'_>, count: usize, element: usize) -> Result<(Vec<u32>, &[u8], usize)> {
        let counted = at.need("count")?;
        let others = counted.whole()?;
        if others == 0 {
            self.note(at, "no elements, left out");
            return Ok(Default::default());
        }
        ensure!(others <= count, counted.refuse(format!("{others} of {count} elements"), "export the file again"));
        let indices = at.need("indices")?;
        let kind = Kind::of(&indices.need("componentType")?)?;
        ensure!(kind.is_unsigned, indices.refuse("indices that are not unsigned integers", "export the file again"));
        let (bytes, stride) = self.elements(&indices, others, kind.size)?;
        self.charge(&counted, others, 4)?;
        let which: Vec<u32> = (0..others).map(|i| kind.whole(&bytes[i * stride..]) as u32).collect();
        let before = |i: usize| i.checked_sub(1).map(|before| which[before]);
        if let Some(i) = (0..others).find(|&i| which[i] as usize >= count || before(i) >= Some(which[i])) {
            let after = before(i).map(|before| format!(", after {before}")).unwrap_or_default();
            let what = format!("index {i} is {}{after}, of {count} elements", which[i]);
            return Err(indices.refuse(what, "list each element once, ascending"));
        }
        let (bytes, stride) = self.elements(&at.need("values")?, others, element)?;
        Ok((which, bytes, stride))
    }
}

const UNFIT: &str = "name an accessor of the type that is expected here";

impl<'a> Accessor<'a> {
    /// Checks that there are `count` elements.
    pub fn of_count(self, count: usize, what: &str) -> Result<Self> {
        let text = || format!("{} elements, but there are {count} {what}", self.count);
        ensure!(self.count == count, self.at.refuse(text(), "export the file again: counts have to agree"));
        Ok(self)
    }

    /// Elements that are not finite have `number` in place of each of theirs, with a note.
    pub fn or_missing(self, number: f32) -> Self {
        Self { missing: Some(number), ..self }
    }

    /// Elements may have fewer numbers than are read; the others are 0.
    pub fn padded(self) -> Self {
        Self { is_padded: true, ..self }
    }

    /// Iterates over the elements that have bytes, ascending; the others are zeros.
    fn stored(&self) -> impl Iterator<Item = (usize, &'a [u8])> {
        let (which, values, stride) = &self.sparse;
        let mut others = which.iter().zip(0..).map(move |(v, n)| (*v as usize, &values[n * stride..])).peekable();
        let all = if self.dense.is_some() { self.count } else { which.len() };
        (0..all).filter_map(move |i| match self.dense {
            Some((bytes, from)) => others.next_if(|(v, _)| *v == i).or(Some((i, &bytes[i * from..]))),
            None => others.next(),
        })
    }

    fn check_components(&self, components: usize) -> Result<()> {
        let what = || format!("elements of {} numbers, {components} expected", self.components);
        let fits = self.components == components || self.is_padded && self.components < components;
        ensure!(fits, self.at.refuse(what(), UNFIT));
        Ok(())
    }

    /// Room for all elements.
    fn zeros<T: Copy, const N: usize>(&self, zero: T) -> Result<Vec<[T; N]>> {
        self.check_components(N)?;
        let mut all = self.file.room(&self.at, self.count)?;
        all.resize(self.count, [zero; N]);
        Ok(all)
    }

    /// Makes the numbers of an element: the first ones by `number`, from the bytes at which they begin.
    fn element<T: Copy, const N: usize>(&self, bytes: &[u8], zero: T, number: impl Fn(&[u8]) -> T) -> [T; N] {
        let size = self.kind.size;
        std::array::from_fn(|c| if c < self.components { number(&bytes[c * size..]) } else { zero })
    }

    /// Passes on each element that has bytes.
    fn each<const N: usize>(&self, mut take: impl FnMut(usize, [f32; N])) -> Result<()> {
        let mut lost = 0;
        for (i, bytes) in self.stored() {
            let mut numbers: [f32; N] = self.element(bytes, 0.0, |bytes| self.kind.number(bytes, self.normalised));
            if !numbers.iter().all(|x| x.is_finite()) {
                let Some(missing) = self.missing else {
                    let remedy = "replace values that are not a number or infinite";
                    return Err(self.at.refuse(format!("element {i} is {numbers:?}"), remedy));
                };
                lost += 1;
                numbers = [missing; N];
            }
            take(i, numbers);
        }
        if lost > 0 {
            let what = format!("elements that are not finite, and count as missing: {lost} of {}", self.count);
            self.file.note(&self.at, what);
        }
        Ok(())
    }

    /// Returns all elements, of `N` numbers each.
    pub fn floats<const N: usize>(&self) -> Result<Vec<[f32; N]>> {
        let mut all = self.zeros(0.0)?;
        self.each(|i, numbers| all[i] = numbers)?;
        Ok(all)
    }

    /// Returns the elements of `N` numbers that are not zero, ascending.
    pub fn deltas<const N: usize>(&self) -> Result<Vec<(u32, [f32; N])>> {
        self.check_components(N)?;
        // Only non-zero elements are kept, since targets are mostly zeros. Each element that is looked at is charged as
        // a byte, since many targets may name the same zeros.
        self.file.charge(&self.at, self.dense.map_or(self.sparse.0.len(), |_| self.count), 1)?;
        let size = self.kind.size * N;
        let moved = self.stored().filter(|(_, bytes)| bytes[..size].iter().any(|byte| *byte != 0)).count();
        let mut found = self.file.room(&self.at, moved)?;
        self.each(|i, numbers| {
            if numbers != [0.0; N] {
                found.push((i as u32, numbers));
            }
        })?;
        Ok(found)
    }

    /// Returns all elements of `N` indices: of vertices or joints. glTF has them as unsigned integers; whole numbers of
    /// other types say the same.
    pub fn indices<const N: usize>(&self) -> Result<Vec<[u32; N]>> {
        let mut all = self.zeros(0)?;
        for (i, bytes) in self.stored() {
            let numbers: [Option<u32>; N] = self.element(bytes, Some(0), |bytes| self.kind.index(bytes));
            for (index, number) in all[i].iter_mut().zip(numbers) {
                let refuse = || self.at.refuse(format!("element {i} is no whole number, 0 or more"), UNFIT);
                *index = number.ok_or_else(refuse)?;
            }
        }
        Ok(all)
    }
}
