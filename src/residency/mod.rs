//! Targets of a mesh in blocks that come to the device and go: which are there, where their deltas lie, and which
//! crowds need them.
//!
//! ```text
//! buffer   [header] [entry of any group, target and block] [base pose of each group]
//! ```
//!
//! Kernels know an entry by the number that a work list gives it, and lists are written by the host. So an entry may
//! lie anywhere. Where all entries have as many words, a list names the place that an entry has now; where headers
//! say where deltas are (`small`), all headers have places of their own, and lists name entries by their numbers as
//! ever.
//!
//! Planning takes updates and swaps as done when they are recorded: they run in that order.

mod holder;
mod space;

use crate::error::{Error, Result};
use crate::pack::PackedMesh;
use crate::pack::blocks::BlockIndex;
use crate::setters::setters;
pub(crate) use holder::Holder;
use space::{Key, Space};
use std::borrow::Cow;
use std::collections::BTreeSet;
use std::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Which targets come to the device and which go: see
/// [`MorphEngine::record_swap`](crate::MorphEngine::record_swap). Targets are counted in the mesh's order, from 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct TargetSwap<'a> {
    /// Targets to have on the device from now on. Those that are there stay.
    pub load: &'a [usize],
    /// Targets whose memory others may take. Those that are not there stay away.
    pub unload: &'a [usize],
}

setters!(TargetSwap<'a> { load: &'a [usize], unload: &'a [usize] });

/// Device memory of a mesh whose targets come and go, in bytes. [`GpuMesh::residency`](crate::GpuMesh::residency)
/// tells it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Residency {
    /// For deltas, in all: what [`MorphEngine::upload_resident`](crate::MorphEngine::upload_resident) was given,
    /// rounded down to whole entries, or less where all targets take less.
    pub capacity: u64,
    /// Taken by the targets that are there. The rest is free, for any targets that take no more in all.
    pub used: u64,
    /// The buffer: `capacity`, what says how deltas are stored, and the base pose. It never grows.
    pub buffer: u64,
}

impl Residency {
    /// Bytes of deltas that are free.
    pub fn free(&self) -> u64 {
        self.capacity - self.used
    }
}

/// The entries that a swap copies.
pub(crate) type Copied = BTreeSet<Key>;

/// Whether a target is on the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Presence {
    Away,
    Resident,
    /// The swap that copied some of it never ran: the next one copies all of it again.
    Lost,
}

/// What changes while a mesh is used.
#[derive(Clone, Debug)]
pub(crate) struct State {
    space: Space,
    /// `[group][entry]`: the first word of its deltas, counted from those of all.
    places: Vec<Vec<u32>>,
    presence: Vec<Presence>,
    /// Crowds whose poses hold a target.
    holders: Vec<u32>,
}

/// A group of the mesh.
struct Group {
    index: Arc<BlockIndex>,
    header_words: u32,
    /// Words of each entry's deltas; 0: its header says where they are.
    entry_words: u32,
    /// Where its headers begin, in words of the buffer.
    headers_at: u32,
    base_at: u32,
}

/// The targets of a mesh, shared by the mesh and its crowds.
pub(crate) struct Residents {
    mesh: String,
    targets: Vec<String>,
    groups: Vec<Group>,
    /// Where deltas begin, in words of the buffer, and how many words there are.
    deltas: Range<u32>,
    end: u32,
    state: Mutex<State>,
}

impl Residents {
    /// No target is there; deltas take `bytes` at most.
    ///
    /// # Errors
    /// A dense format; a target that takes more; more words in all than 32 bits count bytes of.
    pub fn new(mesh: &PackedMesh, bytes: u64) -> Result<Self> {
        let (name, layout) = (&mesh.layout().name, mesh.layout());
        let Some(format) = layout.format.block_format() else {
            let text =
                format!("mesh '{name}', in the dense format '{}', with targets that come and go", layout.format.name());
            return Err(Error::invalid(
                text,
                "pack it in a block format, such as 'fast' or 'small', or upload all of it",
            ));
        };
        let largest = (0..layout.targets.len()).max_by_key(|&target| mesh.target_bytes(target));
        if let Some(largest) = largest.filter(|&target| mesh.target_bytes(target) > bytes) {
            let (target, takes) = (&layout.targets[largest].name, mesh.target_bytes(largest));
            let text = format!("{bytes} bytes for the deltas of mesh '{name}', whose target '{target}' takes {takes}");
            return Err(Error::invalid(text, "allow as many as the targets take that are used at once"));
        }
        let indices = mesh.groups().iter().map(|group| group.layout().index().cloned()).collect::<Result<Vec<_>>>()?;
        let header_words = format.header_words() as u32;
        let entry_words = |index: &BlockIndex| match index.costs.first() {
            Some(cost) if !format.locates_deltas() => cost.bytes / 4 - header_words,
            Some(_) | None => 0,
        };
        // Groups have blocks of one size: where entries have as many words as each other, so they have in all groups.
        let all_words = indices.iter().map(|index| entry_words(index)).max().unwrap_or(0);
        let all: u64 = mesh.groups().iter().map(|group| group.layout().delta_bytes() / 4).sum();
        let mut words = all.min(bytes / 4);
        words -= words % u64::from(all_words.max(1));
        // All positions are counted in 32 bits: deltas of all entries are, and nothing here is more than there is.
        let mut headers = if all_words > 0 { words / u64::from(all_words) } else { 0 };
        let group = |index: &Arc<BlockIndex>| {
            // Lists name entries of one length by place: one header for each place, whichever group has it.
            let first = if all_words > 0 { 0 } else { headers };
            headers = headers.max(first + if all_words > 0 { 0 } else { index.entry_count() as u64 });
            let headers_at = first as u32 * header_words;
            Group { index: index.clone(), header_words, entry_words: all_words, headers_at, base_at: 0 }
        };
        let mut groups: Vec<Group> = indices.iter().map(group).collect();
        let deltas_at = (headers * u64::from(header_words)).next_multiple_of(4);
        let mut end = (deltas_at + words).next_multiple_of(4);
        for (group, packed) in groups.iter_mut().zip(mesh.groups()) {
            group.base_at = end as u32;
            end += packed.layout().base_bytes() / 4;
        }
        if end > u64::from(u32::MAX / 4) {
            let text = format!("mesh '{name}' with {bytes} bytes for its deltas takes {} bytes in all", 4 * end);
            return Err(Error::invalid(text, "allow fewer, or split the mesh"));
        }
        let targets = layout.targets.len();
        let state = State {
            space: Space::new(words as u32),
            places: indices.iter().map(|index| vec![0; index.entry_count()]).collect(),
            presence: vec![Presence::Away; targets],
            holders: vec![0; targets],
        };
        Ok(Self {
            mesh: name.clone(),
            targets: layout.targets.iter().map(|target| target.name.clone()).collect(),
            groups,
            deltas: deltas_at as u32..(deltas_at + words) as u32,
            end: end as u32,
            state: Mutex::new(state),
        })
    }

    /// Where headers, deltas and base pose of a group begin, in words of the buffer.
    pub fn origins(&self, group: usize) -> [u32; 3] {
        let Group { index, headers_at, base_at, .. } = &self.groups[group];
        match index.entry_count() {
            // Kernels are given an entry that moves nothing, in a buffer of its own.
            0 => [0, 0, *base_at],
            _ => [*headers_at, self.deltas.start, *base_at],
        }
    }

    /// Words before the base poses: headers and deltas.
    pub fn words_of_entries(&self) -> u32 {
        self.groups.first().map_or(0, |group| group.base_at)
    }

    pub fn bytes(&self) -> Residency {
        let (capacity, free) = (4 * self.deltas.len() as u64, 4 * u64::from(self.state().space.free()));
        Residency { capacity, used: capacity - free, buffer: 4 * u64::from(self.end) }
    }

    pub fn is_resident(&self, target: usize) -> bool {
        self.state().presence.get(target) == Some(&Presence::Resident)
    }

    /// The state. What panics while it is held has not changed it by then.
    pub fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn entries_of(&self, target: usize) -> impl Iterator<Item = (u32, Key)> {
        let of = move |(number, group): (u32, &Group)| {
            let words = |entry: u32| group.index.costs[entry as usize].bytes / 4 - group.header_words;
            group.index.incidence(target).iter().map(move |i| (words(i.entry), (number, i.entry))).collect::<Vec<_>>()
        };
        (0..).zip(&self.groups).flat_map(of)
    }

    fn name(&self, target: usize) -> String {
        format!("target {target} ('{}') of mesh '{}'", self.targets[target], self.mesh)
    }

    /// Change `state` as `swap` says, and return the entries that have to be copied to their places.
    ///
    /// # Errors
    /// A target that there is not, or that is to come and go; one that poses hold; too few bytes. The state is of no
    /// use then.
    pub fn swap(&self, state: &mut State, swap: &TargetSwap<'_>) -> Result<Copied> {
        let count = self.targets.len();
        if let Some(target) = swap.load.iter().chain(swap.unload).find(|target| **target >= count) {
            let text = format!("target {target} of mesh '{}', which has {count}", self.mesh);
            return Err(Error::invalid(text, "count targets from 0"));
        }
        if let Some(target) = swap.load.iter().find(|target| swap.unload.contains(target)) {
            let text = format!("{} is to come and to go", self.name(*target));
            return Err(Error::invalid(text, "name it in one of both lists"));
        }
        for &target in swap.unload {
            let crowds = state.holders[target];
            if crowds > 0 {
                let text = format!("{} is to go, and poses of {crowds} crowds hold it", self.name(target));
                let remedy =
                    "record an update with its weight at 0 in all instances first, or two where there is a budget";
                return Err(Error::invalid(text, remedy));
            }
            if std::mem::replace(&mut state.presence[target], Presence::Away) != Presence::Away {
                for (_, (group, entry)) in self.entries_of(target).filter(|(words, _)| *words > 0) {
                    state.space.remove(state.places[group as usize][entry as usize]);
                }
            }
        }
        let mut copied = Copied::new();
        for (target, presence) in state.presence.iter_mut().enumerate().filter(|(_, p)| **p == Presence::Lost) {
            *presence = Presence::Resident;
            copied.extend(self.entries_of(target).map(|(_, key)| key));
        }
        let mut entries = vec![];
        for &target in swap.load {
            if std::mem::replace(&mut state.presence[target], Presence::Resident) == Presence::Away {
                entries.extend(self.entries_of(target));
            }
        }
        let (needed, free) = (entries.iter().map(|(words, _)| u64::from(*words)).sum::<u64>(), state.space.free());
        if needed > free.into() {
            let (needed, free) = (4 * needed, 4 * u64::from(free));
            let text =
                format!("targets of {needed} bytes are to come to mesh '{}', which has {free} bytes free", self.mesh);
            return Err(Error::invalid(text, "let others go in the same swap, or upload the mesh with more bytes"));
        }
        copied.extend(entries.iter().map(|(_, key)| *key));
        let State { space, places, .. } = state;
        space.place(entries, |(group, entry), at| {
            places[group as usize][entry as usize] = at;
            copied.insert((group, entry));
        });
        Ok(copied)
    }

    /// Take back a swap that copied these entries and never runs.
    pub fn lose(&self, copied: &Copied) {
        let presence = &mut self.state().presence;
        for (group, entry) in copied {
            let target = self.groups[*group as usize].index.parts.entry_target[*entry as usize] as usize;
            if presence[target] == Presence::Resident {
                presence[target] = Presence::Lost;
            }
        }
    }

    /// What `copied` takes: words one after the other, and for each run of them its first word in the buffer, and how
    /// many. `mesh` is the one that this was made of.
    pub fn copies(&self, state: &State, mesh: &PackedMesh, copied: &Copied) -> (Vec<u32>, Vec<[u32; 2]>) {
        let Some(format) = mesh.layout().format.block_format() else { return (vec![], vec![]) };
        let mut pieces: Vec<(u32, Cow<'_, [u32]>)> = vec![];
        for &(number, entry) in copied {
            let (group, source) = (&self.groups[number as usize], mesh.groups()[number as usize].deltas());
            let (header, deltas) = group.index.locate(format, source, entry as usize);
            let place = state.places[number as usize][entry as usize];
            let name = self.names(state, number as usize).of(entry);
            let mut header = Cow::Borrowed(header);
            if format.locates_deltas() {
                header.to_mut()[0] = place;
            }
            pieces.push((group.headers_at + name * group.header_words, header));
            pieces.push((self.deltas.start + place, Cow::Borrowed(&source[deltas])));
        }
        // Neighbours are copied as one.
        pieces.retain(|(_, piece)| !piece.is_empty());
        pieces.sort_unstable_by_key(|(at, _)| *at);
        let (mut words, mut runs): (Vec<u32>, Vec<[u32; 2]>) = (vec![], vec![]);
        for (at, piece) in pieces {
            match runs.last_mut().filter(|run| run[0] + run[1] == at) {
                Some(run) => run[1] += piece.len() as u32,
                None => runs.push([at, piece.len() as u32]),
            }
            words.extend_from_slice(&piece);
        }
        (words, runs)
    }

    /// What lists call the entries of a group.
    pub fn names<'a>(&self, state: &'a State, group: usize) -> Names<'a> {
        Names { places: &state.places[group], entry_words: self.groups[group].entry_words }
    }
}

/// What lists call the entries of a group.
#[derive(Clone, Copy)]
pub(crate) struct Names<'a> {
    places: &'a [u32],
    entry_words: u32,
}

impl Names<'_> {
    /// Of an entry that is not there, which lists have only with a coefficient of 0, the name of any.
    pub fn of(self, entry: u32) -> u32 {
        match self.entry_words {
            0 => entry,
            words => self.places.get(entry as usize).map_or(0, |place| place / words),
        }
    }
}
