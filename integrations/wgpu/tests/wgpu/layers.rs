//! What the validation layers say, which wgpu logs. The tests of `integrations/bevy` listen by this file, too.

use std::sync::{Mutex, Once, PoisonError};

/// What the layers have said.
static MESSAGES: Mutex<Vec<String>> = Mutex::new(vec![]);

/// wgpu logs the messages of the layers, each at least in one line.
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

/// Listen to the layers.
pub fn listen() {
    static LISTEN: Once = Once::new();
    LISTEN.call_once(|| {
        log::set_logger(&Listener).expect("no other logger");
        log::set_max_level(log::LevelFilter::Warn);
    });
}

/// What the validation layers said since the last call, without what is known to be wrong.
pub fn messages() -> Vec<String> {
    let mut messages = std::mem::take(&mut *MESSAGES.lock().unwrap_or_else(PoisonError::into_inner));
    messages.retain(|message| {
        // Lines that follow a message name labels and objects; general messages are those of drivers and of the loader.
        let of_layers = !message.starts_with('\t') && !message.starts_with("GENERAL");
        // Layers of 1.4.363 report two dispatches that write different places of a buffer: `complaints` in
        // tests/common/gpu.rs of deltamorph says more.
        let disjoint = message.contains("SYNC-HAZARD-WRITE-AFTER-WRITE")
            && message.contains("previously written by another vkCmdDispatch");
        // Those of 1.3.239 do not know that SPIR-V may be compiled from WGSL, and find hazards where wgpu moves its own
        // attachments from one layout to another in the next command buffer; later ones do not.
        let wgsl = message.contains("Invalid source language operand: 10");
        let attachment = message.contains("recorded_usage: SYNC_IMAGE_LAYOUT_TRANSITION");
        of_layers && !disjoint && !wgsl && !attachment
    });
    messages
}
