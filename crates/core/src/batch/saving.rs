//! Saved states of a batch: conversion to bytes, and restoring.

use serde::{Deserialize, Serialize};

use crate::actuation::ActuatorPipelines;
use crate::batch::environments::Batch;
use crate::batch::state::Group;
use crate::batch::worker::LaneScalar;
use crate::collision::contact_set::ContactId;
use crate::error::StateMisfit;
use crate::math::lanes::{DelayLine, DestinationLanes, lane_bits};
use crate::sensing::errors::Errors;

/// Saved environments in groups. The number of lanes of a group is the same on every CPU level: 4 for `f64`, 8 for `f32`, and 1 for a
/// single environment.
#[derive(Serialize, Deserialize)]
struct SavedGroups<S> {
    num_envs: usize,
    /// Controls in force, (num_envs, nu).
    ctrl: Vec<f64>,
    /// Active equalities, (num_envs, neq). Empty if every environment has those of the model.
    eq_active: Vec<bool>,
    groups: Vec<Group<S>>,
}

impl<S: LaneScalar> Batch<S> {
    /// Saves the state of environment `env`, or of all environments, as bytes.
    ///
    /// `ctrl` has the controls in force of the saved environments, nu for each. `eq_active` has their active equalities, neq for each, or
    /// is empty for those of the model.
    pub(super) fn save(&self, env: Option<usize>, ctrl: &[f64], eq_active: &[f64]) -> Vec<u8> {
        let n = if env.is_some() { 1 } else { self.saved_lanes() };
        let first = match env {
            Some(env) => env..env + 1,
            None => 0..self.num_envs,
        };
        let parts = first.clone().step_by(n).map(|first| {
            let (group, lane) = self.lane(first);
            group.part(lane, n).canonical()
        });
        let eq_active = eq_active.iter().map(|&active| active != 0.0).collect();
        let saved = SavedGroups { num_envs: first.len(), ctrl: ctrl.to_vec(), eq_active, groups: parts.collect() };
        // A number takes at most ten bytes, and most take eight, as in memory. The buffer therefore never grows.
        let capacity = saved.groups.iter().map(Group::bytes).sum::<usize>() + 10 * (saved.ctrl.len() + 2);
        postcard::to_extend(&saved, Vec::with_capacity(capacity)).expect("numbers serialise")
    }

    /// Restores a saved state in the environments `envs`, and returns the saved controls and active equalities. [`Batch::save`] made the
    /// bytes.
    ///
    /// If the saved state has as many environments as the batch, each of `envs` gets the state with the same index. A saved state of one
    /// environment goes to all of `envs`.
    ///
    /// # Errors
    /// The first mismatch between the saved state and the batch. Nothing is changed in this case.
    pub(super) fn restore(&mut self, bytes: &[u8], envs: &[usize]) -> Result<(Vec<f64>, Vec<bool>), StateMisfit> {
        let read = postcard::take_from_bytes::<SavedGroups<S>>(bytes);
        let (saved, rest) = read.map_err(|e| StateMisfit::Unreadable(e.to_string()))?;
        if !rest.is_empty() {
            return Err(StateMisfit::TooManyBytes(rest.len()));
        }
        self.check_saved(&saved)?;
        if saved.num_envs == self.num_envs && envs.len() == self.num_envs {
            let n = self.saved_lanes();
            for (part, saved) in saved.groups.iter().enumerate() {
                let (group, lane) = self.lane_mut(part * n);
                group.set_part(DestinationLanes::StartingAt(lane), saved);
            }
        } else {
            self.restore_some(&saved, envs);
        }
        Ok((saved.ctrl, saved.eq_active))
    }
}

impl<S: LaneScalar> Batch<S> {
    /// Checks that a saved state fits this batch: number of environments, sizes, and valid contents.
    fn check_saved(&self, saved: &SavedGroups<S>) -> Result<(), StateMisfit> {
        if saved.num_envs != self.num_envs && saved.num_envs != 1 {
            return Err(StateMisfit::NumEnvs { found: saved.num_envs, must: self.num_envs });
        }
        let n = if saved.num_envs == 1 { 1 } else { self.saved_lanes() };
        let shape = self.lane(0).0.part(0, n);
        let fits = |(part, saved): (usize, &Group<S>)| {
            let (group, lane) = self.lane(part * n);
            saved.lanes == n && saved.fits(&shape) && saved.alive == lane_bits(group.alive, lane, n)
        };
        let nu = self.compiled.actuators.len();
        let neq: usize = self.compiled.equalities.iter().map(|block| block.equalities.len()).sum();
        let switches = saved.eq_active.is_empty() || saved.eq_active.len() == saved.num_envs * neq;
        let whole = switches && saved.groups.len() == saved.num_envs.div_ceil(n) && saved.ctrl.len() == saved.num_envs * nu;
        if !whole || !saved.groups.iter().enumerate().all(fits) {
            return Err(StateMisfit::Shape);
        }
        let finite = |x: &[S]| x.iter().all(|x| x.to_f64().is_finite());
        let moves = |g: &Group<S>| finite(&g.q) && finite(&g.v) && finite(&g.act) && g.time.iter().all(|t| t.is_finite());
        if !saved.groups.iter().all(moves) {
            return Err(StateMisfit::NotFinite);
        }
        let contacts_exist = |g: &Group<S>| {
            let known = |&id: &u64| id == 0 || self.compiled.pair_geoms(ContactId(id).pair()).is_some();
            g.has_whole_contacts(self.max_contacts, self.compiled.has_rolling_friction) && g.contact_ids.iter().all(known)
        };
        if !saved.groups.iter().all(contacts_exist) {
            return Err(StateMisfit::Contacts);
        }
        let lines_exist = |g: &Group<S>| {
            let fits = |(line, &cursor): (DelayLine, &u32)| (cursor as usize) < line.samples.max(1);
            let [sensors, actuators] = self.delay_lines();
            sensors.into_iter().zip(&g.sensing.cursors).all(fits) && actuators.into_iter().zip(&g.actuation.cursors).all(fits)
        };
        if !saved.groups.iter().all(lines_exist) {
            return Err(StateMisfit::DelayLines);
        }
        Ok(())
    }

    /// Delay lines of the sensors, and delay lines of the actuators.
    fn delay_lines(&self) -> [Vec<DelayLine>; 2] {
        let sensors = self.sensor_errors.iter().flat_map(Errors::delay_lines).collect();
        [sensors, self.pipelines.iter().flat_map(ActuatorPipelines::delay_lines).collect()]
    }

    /// Restores saved environments one by one in the environments `envs`.
    ///
    /// All environments of a batch have their newest sample at the same index of a delay line. The function therefore rotates the saved
    /// delay lines to the index of this batch. If a single saved environment goes to several environments, each continues with different
    /// random numbers.
    fn restore_some(&mut self, saved: &SavedGroups<S>, envs: &[usize]) {
        let lines = self.delay_lines();
        // All environments step together, so that the delay lines of all groups have the same position.
        let places = [self.groups[0].sensing.cursors.clone(), self.groups[0].actuation.cursors.clone()];
        let turn = |mut part: Group<S>| {
            let memories =
                [(&mut part.sensing.numbers, &mut part.sensing.cursors), (&mut part.actuation.numbers, &mut part.actuation.cursors)];
            for ((lines, places), (numbers, cursors)) in lines.iter().zip(&places).zip(memories) {
                for ((line, cursor), &place) in lines.iter().zip(cursors.iter_mut()).zip(places) {
                    line.turn(numbers, *cursor, place);
                    *cursor = place;
                }
            }
            part
        };
        if saved.num_envs == 1 && self.num_envs > 1 {
            let part = turn(saved.groups[0].clone());
            let lanes = self.lanes;
            for envs in envs.chunk_by(|a, b| a / lanes == b / lanes) {
                let (group, _) = self.lane_mut(envs[0]);
                let streams = group.sensing.stream.clone();
                group.set_part(DestinationLanes::Each(envs.iter().fold(0, |set, env| set | 1 << (env % lanes))), &part);
                group.sensing.stream = streams;
            }
            return;
        }
        let n = self.saved_lanes();
        for &env in envs {
            let part = turn(saved.groups[env / n].part(env % n, 1));
            let (group, lane) = self.lane_mut(env);
            group.set_part(DestinationLanes::StartingAt(lane), &part);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::batch::saved_state::SavedState;
    use crate::batch::simulation::Simulation;
    use crate::math::precision::Precision;
    use crate::model::{BodyBuilder, GeomBuilder, JointBuilder, Model, WORLD};
    use crate::options::Options;

    /// Simulation of three boxes on a floor.
    fn boxes() -> Simulation {
        let mut scene = Model::builder("box");
        scene.geom(WORLD, GeomBuilder::plane("floor"));
        let body = BodyBuilder::new("box").pos([0.0, 0.0, 0.1]).joint(JointBuilder::free("root"));
        scene.body(WORLD, body.geom(GeomBuilder::cuboid("box", [0.1; 3]).mass(2.0)));
        let options = Options { max_contacts: Some(16), ..Options::default() };
        Simulation::new(Arc::new(scene.finish().unwrap()), options, Some(3), Precision::F64, 1).unwrap()
    }

    /// Saved state of `sim` with two contacts in each environment, in groups with space for `capacity` contacts. `change` edits each group
    /// first.
    fn touching(sim: &Simulation, capacity: usize, change: impl Fn(&mut Group<f64>)) -> SavedState {
        let state = sim.save_state();
        let mut saved = postcard::from_bytes::<SavedGroups<f64>>(&state.payload).unwrap();
        for group in &mut saved.groups {
            let (lanes, entries) = (group.lanes, capacity * group.lanes);
            group.contact_ids.resize(entries, 0);
            group.contact_data.resize(10 * entries, 0.0);
            for lane in (0..lanes).filter(|lane| group.alive >> lane & 1 == 1) {
                group.contact_count[lane] = 2;
                let numbers = group.contact_data.iter_mut().skip(lane).step_by(lanes).take(20);
                numbers.enumerate().for_each(|(k, x)| *x = 1.0 + k as f64);
            }
            change(group);
        }
        SavedState::new(state.model(), state.precision(), postcard::to_stdvec(&saved).unwrap())
    }

    #[test]
    fn a_state_with_capacity_for_more_contacts_is_the_same() {
        let mut sim = boxes();
        let [state, older] = [2, 4].map(|capacity| touching(&sim, capacity, |_| ()));
        assert!(older.nbytes() > state.nbytes() + 3 * 2 * 10 * 8);
        for given in [older, state.clone()] {
            sim.restore_state(&given).unwrap();
            assert_eq!(sim.save_state(), state);
            // The state of one environment, restored to all of them.
            let one = sim.save_state_of(1);
            sim.restore_state(&one).unwrap();
            assert_eq!(sim.save_state(), state);
        }
    }

    #[test]
    fn a_state_without_the_contacts_that_it_counts_is_refused() {
        let mut sim = boxes();
        let before = sim.save_state();
        let short = |group: &mut Group<f64>| group.contact_data.truncate(group.contact_data.len() - 1);
        let counts = |group: &mut Group<f64>| group.contact_count[0] = 3;
        let uneven = |group: &mut Group<f64>| group.contact_ids.push(0);
        let rolling = |group: &mut Group<f64>| group.contact_torque.push(0.0);
        for wrong in [
            touching(&sim, 2, short),
            touching(&sim, 2, counts),
            touching(&sim, 2, uneven),
            touching(&sim, 2, rolling),
            touching(&sim, 17, |_| ()),
        ] {
            assert!(sim.restore_state(&wrong).is_err());
        }
        assert_eq!(sim.save_state(), before);
    }
}
