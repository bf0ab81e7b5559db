//! Accessors: arrays of numbers of any component type, normalised or not, with any stride; dense, sparse or all zero.

use super::container::Container;
use super::json::At;
use crate::error::{Error, Result};

/// An array of elements of `components` numbers each.
#[derive(Debug)]
pub struct Accessor<'a> {
    file: &'a Container,
    at: At<'a>,
    pub count: usize,
    pub components: usize,
    number: Number,
    /// Bytes from the first element on, and the stride of elements. `None`: zeros.
    dense: Option<(&'a [u8], usize)>,
    /// Elements with other values: their indices, ascending; their bytes from the first one on; and the stride.
    sparse: Option<(Vec<u32>, &'a [u8], usize)>,
}

/// The storage of a number.
#[derive(Clone, Copy, Debug)]
struct Number {
    kind: Kind,
    normalised: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Kind {
    fn of(at: &At<'_>) -> Result<Self> {
        Ok(match at.whole()? {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            n => return Err(at.refuse(format!("{n} is no component type of glTF 2.0"), "export the file again")),
        })
    }

    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }

    fn whole(self, b: &[u8]) -> i64 {
        match self {
            Self::I8 => i64::from(b[0] as i8),
            Self::U8 => b[0].into(),
            Self::I16 => i16::from_le_bytes([b[0], b[1]]).into(),
            Self::U16 => u16::from_le_bytes([b[0], b[1]]).into(),
            Self::U32 | Self::F32 => u32::from_le_bytes([b[0], b[1], b[2], b[3]]).into(),
        }
    }
}

impl Number {
    /// Reads the number at the start of `b`. Normalised integers are fractions of the largest one, at least -1.
    fn read(self, b: &[u8]) -> f32 {
        let largest = match self.kind {
            Kind::F32 => return f32::from_le_bytes([b[0], b[1], b[2], b[3]]),
            Kind::I8 => 127.0,
            Kind::U8 => 255.0,
            Kind::I16 => 32767.0,
            Kind::U16 => 65535.0,
            Kind::U32 => 4_294_967_295.0,
        };
        let whole = self.kind.whole(b) as f64;
        if self.normalised { (whole / largest).max(-1.0) as f32 } else { whole as f32 }
    }
}

impl Container {
    /// Returns the accessor that `index` names.
    pub fn accessor(&self, index: &At<'_>) -> Result<Accessor<'_>> {
        let at = self.root().item("accessors", index)?;
        let kind = Kind::of(&at.need("componentType")?)?;
        let counted = at.need("count")?;
        let count = counted.whole()?;
        if count == 0 || u32::try_from(count).is_err() {
            let remedy = "export the file again: accessors have from 1 to 4,294,967,295 elements";
            return Err(counted.refuse(format!("{count} elements"), remedy));
        }
        let shape = at.need("type")?;
        let components = match shape.text()? {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            "MAT4" => 16,
            other => return Err(shape.refuse(format!("type '{other}', which meshes and animations do not use"), UNFIT)),
        };
        let element = kind.size() * components;
        let elements = |at: &At<'_>, count: usize, element: usize| {
            let view = self.view(&at.need("bufferView")?)?;
            let offset = at.whole_or("byteOffset", 0)?;
            let stride = view.stride.unwrap_or(element);
            let end = (count - 1).checked_mul(stride).and_then(|n| n.checked_add(element)?.checked_add(offset));
            if stride == 0 || end.is_none_or(|end| end > view.bytes.len()) {
                let what = format!("{count} elements of {element} bytes every {stride} bytes from byte {offset} on");
                let what = format!("{what}, but the buffer view has {} bytes", view.bytes.len());
                return Err(at.refuse(what, "export the file again: it is cut off, or a count is wrong"));
            }
            Ok((&view.bytes[offset..], stride))
        };
        let dense = at.get("bufferView").is_some().then(|| elements(&at, count, element)).transpose()?;
        let mut sparse = None;
        if let Some(stated) = at.get("sparse") {
            let counted = stated.need("count")?;
            let others = counted.whole()?;
            if others == 0 || others > count {
                return Err(counted.refuse(format!("{others} of {count} elements"), "export the file again"));
            }
            let indices = stated.need("indices")?;
            let kind = Kind::of(&indices.need("componentType")?)?;
            if !matches!(kind, Kind::U8 | Kind::U16 | Kind::U32) {
                return Err(indices.refuse("indices that are not unsigned integers", "export the file again"));
            }
            let (bytes, stride) = elements(&indices, others, kind.size())?;
            self.charge(&counted, others, 4)?;
            let which: Vec<u32> = (0..others).map(|i| kind.whole(&bytes[i * stride..]) as u32).collect();
            let before = |i: usize| i.checked_sub(1).map(|before| which[before]);
            if let Some(i) = (0..others).find(|&i| which[i] as usize >= count || before(i) >= Some(which[i])) {
                let after = before(i).map(|before| format!(", after {before}")).unwrap_or_default();
                let what = format!("index {i} is {}{after}, of {count} elements", which[i]);
                return Err(indices.refuse(what, "list each element once, ascending"));
            }
            let (bytes, stride) = elements(&stated.need("values")?, others, element)?;
            sparse = Some((which, bytes, stride));
        }
        let normalised = at.value.get("normalized").is_some_and(|n| n.as_bool() == Some(true));
        Ok(Accessor { file: self, at, count, components, number: Number { kind, normalised }, dense, sparse })
    }
}

const UNFIT: &str = "name an accessor of the type that is expected here";

impl<'a> Accessor<'a> {
    /// Checks that there are `count` elements.
    pub fn of_count(self, count: usize, what: &str) -> Result<Self> {
        if self.count == count {
            return Ok(self);
        }
        let text = format!("{} elements, but there are {count} {what}", self.count);
        Err(self.at.refuse(text, "export the file again: counts have to agree"))
    }

    /// An error about this accessor.
    pub fn refuse(&self, what: impl std::fmt::Display, remedy: &str) -> Error {
        self.at.refuse(what, remedy)
    }

    /// Returns the bytes of an element from its dense or sparse part; `None`: zeros. `sparse` counts the sparse
    /// elements before it; elements must be requested in ascending order.
    fn element(&self, i: usize, sparse: &mut usize) -> Option<&'a [u8]> {
        if let Some((which, bytes, stride)) = &self.sparse
            && which.get(*sparse) == Some(&(i as u32))
        {
            *sparse += 1;
            return Some(&bytes[(*sparse - 1) * stride..]);
        }
        self.dense.map(|(bytes, stride)| &bytes[i * stride..])
    }

    fn numbers<const N: usize>(&self, i: usize, bytes: Option<&[u8]>) -> Result<[f32; N]> {
        let size = self.number.kind.size();
        let numbers = bytes.map_or([0.0; N], |b| std::array::from_fn(|c| self.number.read(&b[c * size..])));
        if numbers.iter().all(|x| x.is_finite()) {
            return Ok(numbers);
        }
        Err(self.at.refuse(format!("element {i} is {numbers:?}"), "replace values that are not a number or infinite"))
    }

    fn check_components(&self, components: usize) -> Result<()> {
        if self.components == components {
            return Ok(());
        }
        Err(self.at.refuse(format!("elements of {} numbers, {components} expected", self.components), UNFIT))
    }

    /// Returns all elements, of `N` numbers each.
    pub fn floats<const N: usize>(&self) -> Result<Vec<[f32; N]>> {
        self.check_components(N)?;
        self.file.charge(&self.at, self.count, 4 * N)?;
        let mut sparse = 0;
        (0..self.count).map(|i| self.numbers(i, self.element(i, &mut sparse))).collect()
    }

    /// Returns the elements of `N` numbers that are not zero, ascending.
    pub fn deltas<const N: usize>(&self) -> Result<Vec<(u32, [f32; N])>> {
        self.check_components(N)?;
        let mut found = vec![];
        let mut keep = |i: usize, bytes| -> Result<()> {
            let numbers = self.numbers(i, bytes)?;
            if numbers != [0.0; N] {
                found.push((i as u32, numbers));
            }
            Ok(())
        };
        match (&self.dense, &self.sparse) {
            (None, None) => {}
            (None, Some((which, ..))) => {
                self.file.charge(&self.at, which.len(), 4 * N + 4)?;
                let mut sparse = 0;
                which.iter().try_for_each(|&i| keep(i as usize, self.element(i as usize, &mut sparse)))?;
            }
            (Some(_), _) => {
                // Only non-zero elements are kept, since targets are mostly zeros. Each element that is looked at is
                // charged as a byte, since many targets may name the same zeros.
                self.file.charge(&self.at, self.count, 1)?;
                let size = self.number.kind.size() * N;
                let mut sparse = 0;
                let mut moves = |i| self.element(i, &mut sparse).is_some_and(|b| b[..size].iter().any(|b| *b != 0));
                self.file.charge(&self.at, (0..self.count).filter(|i| moves(*i)).count(), 4 * N + 4)?;
                let mut sparse = 0;
                (0..self.count).try_for_each(|i| keep(i, self.element(i, &mut sparse)))?;
            }
        }
        Ok(found)
    }

    /// Returns all elements of `N` unsigned integers as they are stored: indices and joints.
    pub fn integers<const N: usize>(&self) -> Result<Vec<[u32; N]>> {
        self.check_components(N)?;
        if !matches!(self.number.kind, Kind::U8 | Kind::U16 | Kind::U32) {
            return Err(self.at.refuse("numbers that are not unsigned integers", UNFIT));
        }
        self.file.charge(&self.at, self.count, 4 * N)?;
        let size = self.number.kind.size();
        let mut sparse = 0;
        let whole = |b: &[u8]| std::array::from_fn(|c| self.number.kind.whole(&b[c * size..]) as u32);
        Ok((0..self.count).map(|i| self.element(i, &mut sparse).map_or([0; N], whole)).collect())
    }
}
