//! Fates of command buffers: submitted, dropped, in a failed submit, out of order, kept.

use crate::common::{
    Host, assert_right, change, decoded, on_every_adapter, submit_and_read, submit_in_vain, uploaded, wait,
};
use crate::poses::dense;
use deltamorph::{CrowdDesc, DeltaFormat, PackedMesh, PoseFormat, UpdateDesc};
use deltamorph_head::Rng;
use deltamorph_wgpu::{Crowd, Morph};

/// A head, and its requested weights.
struct Head {
    morph: Morph,
    mesh: PackedMesh,
    crowd: Crowd,
    weights: Vec<f32>,
    rng: Rng,
}

impl Head {
    fn new(host: &Host, format: DeltaFormat, desc: &CrowdDesc) -> Self {
        let (morph, mesh, uploaded, weights) = uploaded(host, format);
        let crowd = morph.create_crowd(&uploaded, desc).expect("a crowd");
        Self { morph, mesh, crowd, weights, rng: Rng::new(11, 0) }
    }

    /// Changes the weights, and returns the update to them.
    fn update(&mut self) -> deltamorph::Result<Option<wgpu::CommandBuffer>> {
        change(&mut self.rng, &mut self.weights);
        self.crowd.set_weights(0, &self.weights)?;
        self.morph.update([&mut self.crowd])
    }

    fn assert_right(&self, pose: &[u8], what: &str) {
        let view = self.crowd.pose(0).expect("a pose").view;
        assert_right(&decoded(pose, &view), &self.mesh, &self.weights, view.format, what);
    }

    /// Asserts that the next update makes the right pose.
    fn assert_goes_on(&mut self, host: &Host, what: &str) {
        for _ in 0..3 {
            let update = self.update().unwrap_or_else(|e| panic!("{what}: {e}"));
            let pose = submit_and_read(host, update, &self.crowd);
            self.assert_right(&pose, what);
        }
    }
}

fn descs() -> Vec<(DeltaFormat, CrowdDesc)> {
    let blocks = [1, 2, 3].map(|slots| (DeltaFormat::Fast, UpdateDesc { slots, ..UpdateDesc::blocks() }));
    let others = [
        (DeltaFormat::Fast, UpdateDesc { pose: PoseFormat::Fixed16, ..UpdateDesc::blocks() }),
        (DeltaFormat::Snorm16, dense()),
    ];
    blocks.into_iter().chain(others).map(|(format, update)| (format, CrowdDesc::new(update))).collect()
}

#[test]
fn updates_that_are_dropped_or_fail_are_made_again() {
    on_every_adapter(|host| {
        for (format, desc) in descs() {
            let mut head = Head::new(&host, format, &desc);
            // While the GPU is busy: pictures drawn before it has finished may be wrong.
            host.queue.submit(head.update().expect("an update"));
            submit_in_vain(&host, head.update().expect("an update"));
            host.queue.submit(head.update().expect("an update"));
            wait(&host);
            head.assert_goes_on(&host, "after a submit that failed while the GPU was busy");
            let mut fates = Rng::new(5, 0);
            for frame in 0..40 {
                let update = head.update().expect("an update");
                match fates.below(4) {
                    0 => drop(update),
                    1 => {
                        // Known once the GPU has finished all earlier submits.
                        submit_in_vain(&host, update);
                        wait(&host);
                    }
                    // Submitted and not waited for.
                    2 => drop(host.queue.submit(update)),
                    _ => {
                        let pose = submit_and_read(&host, update, &head.crowd);
                        head.assert_right(&pose, &format!("{desc:?}, frame {frame}"));
                    }
                }
            }
        }
    });
}

#[test]
fn updates_out_of_order_are_noticed() {
    on_every_adapter(|host| {
        for (format, desc) in descs() {
            let mut head = Head::new(&host, format, &CrowdDesc { frames_in_flight: 3, ..desc });
            head.assert_goes_on(&host, "in order");
            for kept in [false, true] {
                let [first, second] = [0, 1].map(|_| head.update().expect("an update").expect("a change"));
                match kept {
                    false => drop(host.queue.submit([second, first])),
                    true => {
                        host.queue.submit([second]);
                        host.queue.submit([first]);
                    }
                }
                wait(&host);
                head.assert_goes_on(&host, "the second before the first");
                let [first, second] = [0, 1].map(|_| head.update().expect("an update").expect("a change"));
                host.queue.submit([second]);
                drop(first);
                wait(&host);
                head.assert_goes_on(&host, "the second without the first");
                let [first, second] = [0, 1].map(|_| head.update().expect("an update").expect("a change"));
                host.queue.submit([second]);
                wait(&host);
                let refused = head.update().expect_err("the first is still there").to_string();
                assert!(refused.contains("not submitted") && refused.contains("drop"), "{refused}");
                drop(first);
                head.assert_goes_on(&host, "the second, and the first is kept for a while");
            }
        }
    });
}

#[test]
fn no_more_updates_are_unfinished_than_there_are_lists() {
    on_every_adapter(|host| {
        for (format, desc) in descs() {
            for frames_in_flight in [1, 2] {
                let mut head = Head::new(&host, format, &CrowdDesc { frames_in_flight, ..desc });
                for _ in 0..30 {
                    let update = head.update().expect("an update");
                    host.queue.submit(update);
                }
                head.assert_goes_on(&host, "after thirty updates without a wait");
                // All are kept: the next update has no list.
                let kept: Vec<_> = (0..frames_in_flight).map(|_| head.update().expect("an update")).collect();
                let refused = head.update().expect_err("no list is free").to_string();
                assert!(refused.contains("not submitted"), "{refused}");
                host.queue.submit(kept.into_iter().flatten());
                head.assert_goes_on(&host, "after updates that were kept");
            }
        }
    });
}
