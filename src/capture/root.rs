//! Attributes of the root and other groups, and the length the superblock declares.
//!
//! The library gives a group attribute's text but not its numbers, so the object header is walked
//! here with the library's own decoders. Reads are bounded by the file's length.

use super::error::{CaptureError, LibraryError};
use super::hdf5::format::messages::attr_info::AttributeInfoMessage;
use super::hdf5::format::messages::attribute::AttributeEntry;
use super::hdf5::format::messages::{
    MSG_ATTR_INFO, MSG_ATTRIBUTE, MSG_FLAG_SHARED, MSG_OBJ_HEADER_CONTINUATION,
};
use super::hdf5::format::object_header::{ObjectHeader, ObjectHeaderMessage};
use super::hdf5::format::superblock::{self, SuperblockV0V1, SuperblockV2V3};
use super::hdf5::format::{self, BlockReader, FormatContext, FormatError, FormatResult};
use super::hdf5::{self, Attribute};
use super::links;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

const SIGNATURE: [u8; 8] = *b"\x89HDF\r\n\x1a\n";

/// Continuation blocks followed at most.
const CONTINUATIONS_MAX: usize = 4096;

/// Objects looked at for their names at most.
const OBJECTS_MAX: usize = 10_000;

/// Bytes of one object-header block at most.
const HEADER_BYTES_MAX: u64 = 4 << 20;

/// A root attribute: its number, its text (to be fetched through the library) or why neither.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum RootAttribute {
    /// Not a string.
    Value(Attribute),
    /// A string, to be read by name.
    Text,
    /// There, but not decodable.
    Unreadable(String),
}

/// Reads the root attributes, after checking signature and declared length.
pub(super) fn attributes(path: &Path) -> Result<BTreeMap<String, RootAttribute>, CaptureError> {
    group_attributes(path, "")
}

/// The same for the group of this path of hard links; none if there is no such group.
pub(super) fn group_attributes(
    path: &Path,
    group: &str,
) -> Result<BTreeMap<String, RootAttribute>, CaptureError> {
    let (mut bytes, superblock) = opened(path)?;
    let library = |source: LibraryError| CaptureError::Library {
        file: path.into(),
        object: format!("the attributes of /{group}"),
        source,
    };
    hdf5::guarded(|| attributes_of(&mut bytes, &superblock, group)).map_err(library)
}

/// Path of the first object whose name is not UTF-8, its other bytes escaped; `None`: there is none, or it cannot be told.
pub(super) fn name_not_utf8(path: &Path) -> Option<String> {
    let (mut bytes, superblock) = opened(path).ok()?;
    let search = || Ok::<_, FormatError>(first_name_not_utf8(&mut bytes, &superblock));
    hdf5::guarded(search).ok().flatten()
}

fn first_name_not_utf8(bytes: &mut Bytes, superblock: &Superblock) -> Option<String> {
    let mut ahead = vec![(String::new(), superblock.root)];
    let mut seen = BTreeSet::new();
    while let Some((path, address)) = ahead.pop() {
        if !seen.insert(address) || seen.len() > OBJECTS_MAX {
            continue;
        }
        // What cannot be read has no names.
        let Ok(messages) = header_messages(bytes, &superblock.context, address) else { continue };
        let links = links::names(&messages, &superblock.context, bytes).unwrap_or_default();
        for (name, target) in links {
            match String::from_utf8(name) {
                Ok(name) => ahead.extend(target.map(|to| (format!("{path}/{name}"), to))),
                Err(error) => return Some(format!("{path}/{}", error.as_bytes().escape_ascii())),
            }
        }
    }
    None
}

/// Opens the file, after checking signature and declared length.
fn opened(path: &Path) -> Result<(Bytes, Superblock), CaptureError> {
    let io = |source| CaptureError::Io { file: path.into(), action: "read it", source };
    let mut bytes = Bytes::open(path).map_err(io)?;
    let mut head = [0_u8; 1024];
    let base = find_signature(&mut bytes).map_err(io)?.ok_or_else(|| CaptureError::NotHdf5 {
        file: path.into(),
        found: if bytes.length == 0 { "it is empty".into() } else { "no HDF5 signature".into() },
    })?;
    let n_read = bytes.read_at(base, &mut head).map_err(io)?;
    let library = |source: LibraryError| CaptureError::Library {
        file: path.into(),
        object: "the superblock".into(),
        source,
    };
    let superblock = hdf5::guarded(|| Superblock::decode(&head[..n_read])).map_err(library)?;
    bytes.base = base;
    let declared = superblock.end_of_file;
    if declared > bytes.length {
        return Err(CaptureError::Truncated { file: path.into(), declared, found: bytes.length });
    }
    Ok((bytes, superblock))
}

/// The file as the format's decoders want it: offsets from the superblock on.
struct Bytes {
    file: File,
    length: u64,
    base: u64,
}

impl Bytes {
    fn open(path: &Path) -> std::io::Result<Self> {
        let file = File::open(path)?;
        let length = file.metadata()?.len();
        Ok(Self { file, length, base: 0 })
    }

    fn read_at(&mut self, at: u64, out: &mut [u8]) -> std::io::Result<usize> {
        self.file.seek(SeekFrom::Start(at))?;
        let mut n_read = 0;
        while n_read < out.len() {
            match self.file.read(&mut out[n_read..])? {
                0 => break,
                n => n_read += n,
            }
        }
        Ok(n_read)
    }
}

impl BlockReader for Bytes {
    fn read_block(&mut self, offset: u64, len: usize) -> FormatResult<Vec<u8>> {
        let at = self.base.saturating_add(offset);
        let room = self.length.saturating_sub(at).min(HEADER_BYTES_MAX);
        let mut block = vec![0; usize::try_from(room).unwrap_or(usize::MAX).min(len)];
        let n_read = self
            .read_at(at, &mut block)
            .map_err(|error| FormatError::InvalidData(error.to_string()))?;
        block.truncate(n_read);
        Ok(block)
    }
}

/// Finds the superblock: at 0, or at 512 doubled repeatedly behind a user block.
fn find_signature(bytes: &mut Bytes) -> std::io::Result<Option<u64>> {
    let mut at = 0;
    while at + 8 <= bytes.length {
        let mut found = [0; 8];
        bytes.read_at(at, &mut found)?;
        if found == SIGNATURE {
            return Ok(Some(at));
        }
        at = if at == 0 { 512 } else { at * 2 };
    }
    Ok(None)
}

struct Superblock {
    context: FormatContext,
    root: u64,
    end_of_file: u64,
}

impl Superblock {
    fn decode(head: &[u8]) -> FormatResult<Self> {
        if superblock::detect_superblock_version(head)? < 2 {
            let block = SuperblockV0V1::decode(head)?;
            return Ok(Self {
                context: FormatContext {
                    sizeof_addr: block.sizeof_offsets,
                    sizeof_size: block.sizeof_lengths,
                },
                root: block.root_symbol_table_entry.obj_header_addr,
                end_of_file: block.end_of_file_address,
            });
        }
        let block = SuperblockV2V3::decode(head)?;
        Ok(Self {
            context: FormatContext {
                sizeof_addr: block.sizeof_offsets,
                sizeof_size: block.sizeof_lengths,
            },
            root: block.root_group_object_header_address,
            end_of_file: block.end_of_file_address,
        })
    }
}

fn attributes_of(
    bytes: &mut Bytes,
    superblock: &Superblock,
    group: &str,
) -> FormatResult<BTreeMap<String, RootAttribute>> {
    let context = &superblock.context;
    let mut attributes = BTreeMap::new();
    let mut messages = header_messages(bytes, context, superblock.root)?;
    for name in group.split('/').filter(|name| !name.is_empty()) {
        match links::target(&messages, name, context, bytes)? {
            Some(address) => messages = header_messages(bytes, context, address)?,
            None => return Ok(attributes),
        }
    }
    for message in messages {
        let shared = message.flags & MSG_FLAG_SHARED != 0;
        match message.msg_type {
            MSG_ATTRIBUTE if !shared => {
                insert(&mut attributes, &AttributeEntry::parse(&message.data, context)?);
            }
            MSG_ATTR_INFO if !shared => {
                let (dense, _) = AttributeInfoMessage::decode(&message.data, context)?;
                for entry in format::dense_attr::read_dense_attributes(&dense, context, bytes)? {
                    insert(&mut attributes, &entry);
                }
            }
            _ => {}
        }
    }
    Ok(attributes)
}

fn insert(attributes: &mut BTreeMap<String, RootAttribute>, entry: &AttributeEntry) {
    let value = match entry.decoded() {
        Ok(message) => Attribute::decode(message).map_or(RootAttribute::Text, RootAttribute::Value),
        Err(reason) => RootAttribute::Unreadable(reason.into()),
    };
    attributes.insert(entry.name().into(), value);
}

/// All messages of an object header, continuation blocks included.
fn header_messages(
    bytes: &mut Bytes,
    context: &FormatContext,
    address: u64,
) -> FormatResult<Vec<ObjectHeaderMessage>> {
    let mut block = bytes.read_block(address, 8192)?;
    if let Err(FormatError::BufferTooShort { needed, .. }) = ObjectHeader::decode_any(&block) {
        block = bytes.read_block(address, needed)?;
    }
    let (header, _) = ObjectHeader::decode_any(&block)?;
    let is_v2 = block.starts_with(b"OHDR");
    let ordered = is_v2 && header.flags & 0x04 != 0;
    let mut messages = header.messages;
    let mut seen = BTreeSet::new();
    let mut next = 0;
    while next < messages.len() {
        let message = &messages[next];
        next += 1;
        if message.msg_type != MSG_OBJ_HEADER_CONTINUATION {
            continue;
        }
        let Some((at, length)) = continuation(&message.data, context) else { continue };
        if !seen.insert(at) || seen.len() > CONTINUATIONS_MAX {
            continue;
        }
        let block = bytes.read_block(at, length)?;
        if block.len() != length {
            return Err(FormatError::BufferTooShort { needed: length, available: block.len() });
        }
        if is_v2 {
            parse_v2(&block, ordered, &mut messages)?
        } else {
            parse_v1(&block, &mut messages)
        }
    }
    Ok(messages)
}

fn continuation(data: &[u8], context: &FormatContext) -> Option<(u64, usize)> {
    let (address, rest) = data.split_at_checked(usize::from(context.sizeof_addr))?;
    let length = rest.get(..usize::from(context.sizeof_size))?;
    Some((little_endian(address), usize::try_from(little_endian(length)).ok()?))
}

fn little_endian(bytes: &[u8]) -> u64 {
    bytes.iter().rev().fold(0, |value, &byte| value << 8 | u64::from(byte))
}

/// Version 1: type u16, size u16, flags u8, 3 reserved, data.
fn parse_v1(block: &[u8], messages: &mut Vec<ObjectHeaderMessage>) {
    let mut rest = block;
    while let Some((head, tail)) = rest.split_at_checked(8) {
        let size = usize::from(u16::from_le_bytes([head[2], head[3]]));
        let Some((data, after)) = tail.split_at_checked(size) else { return };
        if head[1] == 0 {
            messages.push(message(head[0], head[4], data));
        }
        rest = after;
    }
}

/// Version 2: `OCHK`, messages (type u8, size u16, flags u8, order u16 if kept), checksum u32.
fn parse_v2(
    block: &[u8],
    ordered: bool,
    messages: &mut Vec<ObjectHeaderMessage>,
) -> FormatResult<()> {
    let checked = block.len().saturating_sub(4);
    let (body, sum) = block.split_at(checked);
    let Some(mut rest) = body.strip_prefix(b"OCHK") else {
        return Err(FormatError::InvalidSignature);
    };
    let computed = format::checksum::checksum_metadata(body);
    let expected = u32::try_from(little_endian(sum)).unwrap_or(0);
    if computed != expected {
        return Err(FormatError::ChecksumMismatch { expected, computed });
    }
    let head_bytes = if ordered { 6 } else { 4 };
    while let Some((head, tail)) = rest.split_at_checked(head_bytes) {
        let size = usize::from(u16::from_le_bytes([head[1], head[2]]));
        let Some((data, after)) = tail.split_at_checked(size) else { break };
        messages.push(message(head[0], head[3], data));
        rest = after;
    }
    Ok(())
}

fn message(msg_type: u8, flags: u8, data: &[u8]) -> ObjectHeaderMessage {
    ObjectHeaderMessage { msg_type, flags, creation_index: 0, data: data.to_vec() }
}
