//! Messages of the validation layers, as logged by wgpu. The tests of `integrations/bevy` use this file, too.

use std::sync::{Mutex, Once, PoisonError};

/// Messages so far.
static MESSAGES: Mutex<Vec<String>> = Mutex::new(vec![]);

/// wgpu logs each message of the layers in at least one line.
struct Listener;

impl log::Log for Listener {
    fn enabled(&self, metadata: &log::Metadata<'_>) -> bool {
        metadata.level() <= log::Level::Warn && metadata.target().starts_with("wgpu_hal::vulkan::instance")
    }

    fn log(&self, record: &log::Record<'_>) {
        if self.enabled(record.metadata()) {
            MESSAGES.lock().unwrap_or_else(PoisonError::into_inner).push(record.args().to_string());
        }
    }

    fn flush(&self) {}
}

/// Starts collecting messages.
pub fn listen() {
    static LISTEN: Once = Once::new();
    LISTEN.call_once(|| {
        log::set_logger(&Listener).expect("no other logger");
        log::set_max_level(log::LevelFilter::Warn);
    });
}

/// Returns the messages since the last call, without known false ones.
pub fn messages() -> Vec<String> {
    let mut messages = std::mem::take(&mut *MESSAGES.lock().unwrap_or_else(PoisonError::into_inner));
    messages.retain(|message| {
        // Lines that follow a message name labels and objects; general messages come from drivers and the loader.
        let of_layers = !message.starts_with('\t') && !message.starts_with("GENERAL");
        // Layers of 1.4.363 report two dispatches that write different ranges of a buffer: see `complaints` in
        // tests/common/gpu.rs of deltamorph.
        let disjoint = message.contains("SYNC-HAZARD-WRITE-AFTER-WRITE")
            && message.contains("previously written by another vkCmdDispatch");
        // Layers of 1.3.239 do not know WGSL as a source language of SPIR-V, and find hazards where wgpu changes the
        // layout of its own attachments in the next command buffer; later ones do not.
        let wgsl = message.contains("Invalid source language operand: 10");
        let attachment = message.contains("recorded_usage: SYNC_IMAGE_LAYOUT_TRANSITION");
        of_layers && !disjoint && !wgsl && !attachment
    });
    messages
}
