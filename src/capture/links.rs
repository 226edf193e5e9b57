//! Hard links of groups: the address of a group's object header, for its attributes.
//!
//! Both generations of group storage: link messages (compact or dense) and symbol tables. Must not
//! know what attributes mean.

use super::hdf5::format::btree_v1::BTreeV1Node;
use super::hdf5::format::dense_link::read_dense_links;
use super::hdf5::format::local_heap::LocalHeapHeader;
use super::hdf5::format::messages::link::{LinkMessage, LinkTarget};
use super::hdf5::format::messages::link_info::LinkInfoMessage;
use super::hdf5::format::messages::{MSG_LINK, MSG_LINK_INFO, MSG_SYMBOL_TABLE};
use super::hdf5::format::object_header::ObjectHeaderMessage;
use super::hdf5::format::symbol_table::SymbolTableNode;
use super::hdf5::format::{BlockReader, FormatContext, FormatResult};
use std::ops::ControlFlow;

/// Nodes of a symbol table's tree visited at most.
const NODES_MAX: usize = 65_536;

/// Bytes of one node read at most.
const NODE_BYTES: usize = 256 << 10;

/// Bytes of a heap of names read at most.
const HEAP_BYTES_MAX: u64 = 4 << 20;

/// Address of what the hard link `name` of the group with these header messages leads to.
pub(super) fn target<R: BlockReader>(
    messages: &[ObjectHeaderMessage],
    name: &str,
    context: &FormatContext,
    bytes: &mut R,
) -> FormatResult<Option<u64>> {
    for message in messages {
        let found = match message.msg_type {
            MSG_LINK => of_link(&LinkMessage::decode(&message.data, context)?.0, name),
            MSG_LINK_INFO => {
                let (info, _) = LinkInfoMessage::decode(&message.data, context)?;
                let links = read_dense_links(&info, context, bytes)?;
                links.iter().find_map(|link| of_link(link, name))
            }
            MSG_SYMBOL_TABLE => {
                let mut found = None;
                of_table(&message.data, context, bytes, &mut |stored, address| {
                    if stored != name.as_bytes() {
                        return ControlFlow::Continue(());
                    }
                    found = Some(address);
                    ControlFlow::Break(())
                })?;
                found
            }
            _ => None,
        };
        if found.is_some() {
            return Ok(found);
        }
    }
    Ok(None)
}

fn of_link(link: &LinkMessage, name: &str) -> Option<u64> {
    match link.target {
        LinkTarget::Hard { address } if link.name == name => Some(address),
        LinkTarget::Hard { .. }
        | LinkTarget::Soft { .. }
        | LinkTarget::External { .. }
        | LinkTarget::UserDefined { .. } => None,
    }
}

/// Names of the links of the group with these header messages, as they are stored, and what hard ones lead to; without
/// those of a heap of links.
pub(super) fn names<R: BlockReader>(
    messages: &[ObjectHeaderMessage],
    context: &FormatContext,
    bytes: &mut R,
) -> FormatResult<Vec<(Vec<u8>, Option<u64>)>> {
    let mut found = Vec::new();
    for message in messages {
        match message.msg_type {
            MSG_LINK => match LinkMessage::decode(&message.data, context) {
                Ok((link, _)) => {
                    let target = of_link(&link, &link.name);
                    found.push((link.name.into_bytes(), target));
                }
                Err(_) => found.extend(stored_name(&message.data).map(|name| (name, None))),
            },
            MSG_SYMBOL_TABLE => of_table(&message.data, context, bytes, &mut |name, address| {
                found.push((name.to_owned(), Some(address)));
                ControlFlow::Continue(())
            })?,
            _ => {}
        }
    }
    Ok(found)
}

/// The name in a link message: version, flags, as they say a type, an order and a character set, the name's length.
fn stored_name(message: &[u8]) -> Option<Vec<u8>> {
    let flags = *message.get(1)?;
    let optional = [(0x08, 1), (0x04, 8), (0x10, 1)];
    let before: usize = optional.iter().filter(|(flag, _)| flags & flag != 0).map(|(_, n)| n).sum();
    let (length, rest) = message.get(2 + before..)?.split_at_checked(1 << (flags & 3))?;
    Some(rest.get(..usize::try_from(little_endian(length)).ok()?)?.to_vec())
}

/// Visits the links of a symbol table, a tree of nodes and a heap of names, until `visit` says so.
fn of_table<R: BlockReader>(
    message: &[u8],
    context: &FormatContext,
    bytes: &mut R,
    visit: &mut dyn FnMut(&[u8], u64) -> ControlFlow<()>,
) -> FormatResult<()> {
    let (address_bytes, size_bytes) =
        (usize::from(context.sizeof_addr), usize::from(context.sizeof_size));
    let Some((tree, rest)) = message.split_at_checked(address_bytes) else { return Ok(()) };
    let Some(heap) = rest.get(..address_bytes) else { return Ok(()) };
    let head = bytes.read_block(little_endian(heap), 64)?;
    let heap = LocalHeapHeader::decode(&head, address_bytes, size_bytes)?;
    let heap_bytes = usize::try_from(heap.data_size.min(HEAP_BYTES_MAX)).unwrap_or(0);
    let names = bytes.read_block(heap.data_addr, heap_bytes)?;
    let mut ahead = vec![little_endian(tree)];
    let mut n_nodes = 0;
    while let Some(address) = ahead.pop() {
        n_nodes += 1;
        if n_nodes > NODES_MAX {
            return Ok(());
        }
        let block = bytes.read_block(address, NODE_BYTES)?;
        if block.starts_with(b"TREE") {
            let node = BTreeV1Node::decode(&block, address_bytes, size_bytes, u16::MAX)?;
            ahead.extend(node.children);
            continue;
        }
        let node = SymbolTableNode::decode(&block, address_bytes, size_bytes, u16::MAX)?;
        for entry in node.entries {
            let at = usize::try_from(entry.name_offset).unwrap_or(usize::MAX);
            let rest = names.get(at..).unwrap_or_default();
            let name = rest.split(|byte| *byte == 0).next().unwrap_or_default();
            if visit(name, entry.obj_header_addr).is_break() {
                return Ok(());
            }
        }
    }
    Ok(())
}

fn little_endian(bytes: &[u8]) -> u64 {
    bytes.iter().rev().fold(0, |value, &byte| value << 8 | u64::from(byte))
}
