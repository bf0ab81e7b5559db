//! What crowds on a device and on the CPU do alike: instances and their requested weights.

/// Methods of a crowd with the fields `instances` and `updates`, and these methods of its own: `layout`; `grid`, of the
/// first group, if poses are fixed-point; `parts`, the instances and what the planner of updates keeps of each; and
/// `change_outputs`, which tells post-morph passes what becomes of the outputs of an instance.
macro_rules! crowd_methods {
    () => {
        /// Makes the next pose of `instance` its own previous pose, so that its motion vectors are zero, such as after
        /// a teleport. [`set_hidden`](Self::set_hidden) implies it.
        ///
        /// # Errors
        /// An instance out of range or removed.
        pub fn reset_history(&mut self, instance: u32) -> Result<()> {
            self.instances.reset_history(instance)?;
            self.parts().1.reset_history(instance);
            self.change_outputs(instance, OutputChange::Reset);
            Ok(())
        }

        /// Hides or shows `instance`. A hidden instance keeps its pose and is left out of updates. Once shown, the next
        /// update applies its requested weights, with the new pose as previous pose.
        ///
        /// # Errors
        /// An instance out of range or removed.
        pub fn set_hidden(&mut self, instance: u32, hidden: bool) -> Result<()> {
            if self.instances.set_hidden(instance, hidden)? {
                self.parts().1.set_hidden(instance, hidden);
                self.change_outputs(instance, OutputChange::Renewed);
            }
            Ok(())
        }

        /// Adds an instance and returns its number, one that [`remove`](Self::remove) has freed. It is shown, with all
        /// weights 0 and the crowd's error budget, and the next update writes its pose from the base pose.
        ///
        /// # Errors
        /// All instances of the crowd's capacity are in use, as they are in a new crowd.
        pub fn add(&mut self) -> Result<u32> {
            let instance = self.instances.add()?;
            self.parts().1.add(instance);
            Ok(instance)
        }

        /// Removes an instance. The crowd keeps its memory for the next one added.
        ///
        /// # Errors
        /// An instance out of range or removed.
        pub fn remove(&mut self, instance: u32) -> Result<()> {
            self.instances.remove(instance)?;
            self.parts().1.set_hidden(instance, true);
            self.change_outputs(instance, OutputChange::Removed);
            Ok(())
        }

        /// The instances that are shown, ascending.
        pub fn shown(&self) -> impl Iterator<Item = u32> {
            self.instances.requested().zip(0..).filter_map(|(requested, i)| requested.map(|_| i))
        }

        /// Sets the requested weights of `instance`, one per target in the mesh's order, from the next update on.
        ///
        /// # Errors
        /// An instance out of range or removed; a wrong number of weights; a weight that is not finite or out of range;
        /// more active targets than a draw of `direct-attributes` supports; a crowd that plays clips. Nothing changes
        /// then.
        pub fn set_weights(&mut self, instance: u32, weights: &[f32]) -> Result<()> {
            self.instances.check(instance)?;
            self.parts().1.check_takes_weights()?;
            check_weights(weights, self.layout(), self.grid())?;
            self.parts().1.check_weights(weights)?;
            self.instances.set_weights(instance, weights)
        }

        /// Sets the requested weight of one target of `instance`, from the next update on. `target` is an index in the
        /// mesh's order, as of [`PackedLayout::target_index`](crate::PackedLayout::target_index).
        ///
        /// # Errors
        /// A target out of range, and the errors of [`set_weights`](Self::set_weights). Nothing changes then.
        pub fn set_weight(&mut self, instance: u32, target: usize, weight: f32) -> Result<()> {
            self.instances.check(instance)?;
            self.parts().1.check_takes_weights()?;
            check_weight(target, weight, self.layout(), self.grid())?;
            let (instances, state) = self.parts();
            let before = instances.set_weight(instance, target, weight)?;
            // A weight of 0 cannot exceed a limit of the technique.
            let checked = match weight == 0.0 {
                true => Ok(()),
                false => state.check_weights(instances.weights(instance)?),
            };
            if checked.is_err() {
                instances.set_weight(instance, target, before)?;
            }
            checked
        }

        /// Sets the error budget of `instance` from the next update on, in input units; at most
        /// [`UpdateDesc::error_budget`](crate::UpdateDesc::error_budget), the default.
        /// [`lod::Level::error_budget`](crate::lod::Level::error_budget) converts it from pixels. If it
        /// decreases, the next update applies changes deferred beyond it.
        ///
        /// # Errors
        /// An instance out of range or removed; a value outside 0 to the crowd's budget; a path or a delta format
        /// without error budgets.
        pub fn set_error_budget(&mut self, instance: u32, budget: f32) -> Result<()> {
            self.instances.check(instance)?;
            self.parts().1.set_error_budget(instance, budget)
        }

        /// The requested weights of `instance`, one per target in the mesh's order, as they were set. Applied weights
        /// may differ: fixed-point poses round them to their grid, and an error budget may defer changes. Empty if the
        /// crowd plays clips.
        ///
        /// # Errors
        /// An instance out of range or removed.
        pub fn weights(&self, instance: u32) -> Result<&[f32]> {
            self.instances.weights(instance)
        }

        /// Vertices that the last update changed in the pose of `instance`, as ascending ranges in pose-buffer order:
        /// whole blocks in block formats, all vertices if only the GPU knows (crowds that play clips), none if nothing
        /// changed. For acceleration structures, picking, or copies that follow the pose.
        pub fn changed(&mut self, instance: u32) -> Vec<std::ops::Range<u32>> {
            let (mut changed, updates) = (vec![], self.updates);
            let vertices = self.layout().vertex_count as u32;
            let (instances, state) = self.parts();
            if updates > 0 && instances.check(instance).is_ok() {
                state.changed(instances, updates, instance, 0, &mut changed);
            }
            let merged = changed.chunk_by(|a, b| a.end == b.start).map(|run| run[0].start..run[run.len() - 1].end);
            merged.map(|range| range.start..range.end.min(vertices)).filter(|range| !range.is_empty()).collect()
        }
    };
}
pub(crate) use crowd_methods;
