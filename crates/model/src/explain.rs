//! Report of a model as text: simulated elements, omitted elements with reasons, unused features, and phenomena that rigid-body simulation
//! does not cover.

use std::collections::BTreeMap;
use std::fmt::Display;

use crate::Kernel;
use crate::pairs::{Verdict, weld_groups};
use crate::{Activation, JointKind, Model, Requested};

/// Phenomena that rigid-body simulation does not model, in any scene.
const BEYOND: [&str; 7] = [
    "deformation: bodies and contacts are rigid; a contact patch is a few points, and stress, vibration and sound inside bodies do not exist",
    "impacts that take time: a collision is instantaneous, its loss of energy one coefficient of restitution",
    "friction beyond Coulomb's law: no static peak, no dependence on speed, temperature, humidity, wear or lubrication",
    "joints with play, flexible gears and links, backlash, friction that depends on load",
    "flow of air and water (drag and lift, if any, are formulas of each body's own velocity), cables, cloth, soil and other soft matter",
    "motors and their electronics: heat, saturation, cogging, bus voltage, unless the actuator's numbers say so",
    "adhesion, magnetism, electrostatics",
];

impl Model {
    /// Report of the model as text. It lists simulated elements, omitted elements with reasons, features that the scene does not use, and
    /// phenomena that rigid-body simulation does not cover.
    pub fn explain(&self) -> String {
        let name = if self.name.is_empty() { "model" } else { &self.name };
        let sizes = format!(
            "{name}: nq {}, nv {}, nu {}, na {}; {} bodies, {} joints, {} geoms; time step {} s, gravity {:?} m/s^2",
            self.nq(),
            self.nv(),
            self.nu(),
            self.na(),
            self.bodies.len(),
            self.joints.len(),
            self.geoms.len(),
            self.timestep,
            self.gravity
        );
        let (modelled, absent): (Vec<_>, Vec<_>) =
            [self.links(), self.joint_kinds(), self.collision(), self.joint_forces(), self.loops(), self.drives(), self.readings()]
                .concat()
                .into_iter()
                .partition(|line| line.present);
        let text = |lines: Vec<Line>| lines.into_iter().map(|l| l.text).collect::<Vec<_>>();
        let (changing, harmless) = self.left_out();
        [
            sizes,
            section("The source asks for it, and by default something else runs", &self.deviations(true)),
            section("Modelled", &text(modelled)),
            section("Left out, and the motion is different for it", &changing),
            section("Left out, not counted as a change of the motion", &harmless),
            section("Costs nothing: this scene has no", &text(absent)),
            section("Beyond rigid bodies, whatever the scene", &BEYOND.map(String::from)),
        ]
        .join("\n\n")
    }

    /// Settings of the source file that the default options replace, as one line of text each. If `implied` is true, the list includes
    /// settings that the file leaves at the defaults of MuJoCo.
    pub fn deviations(&self, implied: bool) -> Vec<String> {
        let Some(asked) = &self.requested else { return vec![] };
        let lines = [asked.integrator_line(), asked.softness_line(), asked.cone_line(), self.noslip_line()];
        lines.into_iter().flatten().filter(|(express, _)| *express || implied).map(|(_, line)| line).collect()
    }

    fn noslip_line(&self) -> Deviation {
        let sweeps = self.soft.noslip.iterations;
        let line = format!(
            "noslip: the source asks for {sweeps} sweeps at the most that take the slip out of friction; hard contact has no such slip and \
             makes none. Options::from_model(&model) takes them"
        );
        (sweeps > 0).then_some((true, line))
    }

    fn links(&self) -> Vec<Line> {
        let (group, moves) = weld_groups(self);
        let count = moves.iter().filter(|m| **m).count();
        let merged: Vec<usize> = (1..self.bodies.len()).filter(|&b| group[b] != b).collect();
        let into = |b: usize| format!("{} into {}", self.body_label(b), self.body_label(group[b]));
        let mocap = (1..self.bodies.len()).filter(|&b| self.bodies[b].mocap).map(|b| self.body_label(b));
        vec![
            Line::new(count, format!("{count} moving links"), "moving links"),
            Line::new(
                merged.len(),
                format!(
                    "{} bodies merged, as they cannot move against their parent: {}",
                    merged.len(),
                    short(merged.into_iter().map(into))
                ),
                "bodies to merge",
            ),
            Line::list("bodies posed by the user", mocap),
        ]
    }

    fn joint_kinds(&self) -> Vec<Line> {
        let kinds = [(JointKind::Free, "free"), (JointKind::Ball, "ball"), (JointKind::Slide, "slide"), (JointKind::Hinge, "hinge")];
        let count = |kind| self.joints.iter().filter(|j| j.kind == kind).count();
        kinds.map(|(kind, name)| Line::new(count(kind), format!("{} {name} joints", count(kind)), format!("{name} joints"))).to_vec()
    }

    fn collision(&self) -> Vec<Line> {
        let census = self.pair_census();
        let total: usize = census.values().sum();
        let dropped: Vec<String> = census.iter().filter(|(v, _)| !v.collides()).map(|(v, n)| format!("{n} {}", v.why())).collect();
        let pairs = self.collision_pairs();
        let (kept, missing): (Vec<_>, Vec<_>) =
            pairs.iter().partition(|p| Kernel::of(&self.geoms[p.geoms[0]].shape, &self.geoms[p.geoms[1]].shape).is_some());
        let others = if dropped.is_empty() { String::new() } else { format!("; of the others {}", dropped.join(", ")) };
        let slick = kept.iter().filter(|p| p.condim == 1).count();
        let bouncing = kept.iter().filter(|p| p.restitution > 0.0).count();
        let giving = kept.iter().filter(|p| !p.spring.is_rigid()).count();
        let turning = kept.iter().filter(|p| p.condim > 3).count();
        let rough = kept.len() - slick - turning;
        vec![
            Line::new(kept.len(), format!("{} of {total} geom pairs can collide{others}", kept.len()), "pairs of geoms that can collide"),
            Line::new(
                missing.len(),
                format!("{} more would collide but for what is left out below", missing.len()),
                "collision pairs of shapes that are not simulated yet",
            ),
            Line::new(rough, format!("{rough} pairs with sliding friction: 3 rows a contact, the exact circular Coulomb cone"), "friction"),
            Line::new(
                turning,
                format!("{turning} pairs with torsional or rolling friction too: 6 rows a contact, one elliptic cone"),
                "torsional or rolling friction",
            ),
            Line::new(
                self.soft.noslip.iterations as usize,
                format!("{} noslip sweeps at the most after MuJoCo's law; hard contact makes none", self.soft.noslip.iterations),
                "noslip sweeps",
            ),
            Line::new(slick, format!("{slick} frictionless pairs: 1 row a contact"), "frictionless contacts"),
            Line::new(bouncing, format!("{bouncing} pairs bounce (Newton's restitution)"), "restitution"),
            Line::new(giving, format!("{giving} pairs give way by a spring and a damper (N/m, N s/m)"), "contact stiffness"),
        ]
    }

    fn joint_forces(&self) -> Vec<Line> {
        let with = |what: &str, has: &dyn Fn(&crate::Joint) -> bool| {
            let joints = (0..self.joints.len()).filter(|&j| has(&self.joints[j])).map(|j| self.joint_label(j));
            Line::list(what, joints)
        };
        vec![
            with("joint limits", &|j| j.range.is_some()),
            with("joint springs", &|j| j.stiffness != 0.0),
            with("joint damping", &|j| j.damping != 0.0),
            with("rotor inertia", &|j| j.armature != 0.0),
            with("dry friction in joints", &|j| j.frictionloss != 0.0),
            with("bounds of the sum of actuator forces", &|j| j.actuator_force_range.is_some()),
            self.surroundings(),
            Line::list(
                "bodies whose weight is held up",
                of(self.bodies.len(), &|b| self.bodies[b].gravcomp != 0.0, &|b| self.body_label(b)),
            ),
            Line::list(
                "geoms with a moving surface",
                of(self.geoms.len(), &|g| self.geoms[g].surface_velocity != [0.0; 6], &|g| self.geom_label(g)),
            ),
        ]
    }

    fn loops(&self) -> Vec<Line> {
        let named = |active: bool, hard: bool| {
            let chosen = self.equalities.iter().enumerate();
            let chosen = chosen.filter(move |(_, e)| e.active == active && (!active || e.stiffness.is_infinite() == hard));
            chosen.map(|(i, e)| format!("{} ({})", crate::label(&e.name, i), e.kind.name()))
        };
        vec![
            Line::list("hard equalities", named(true, true)),
            Line::list("soft equalities", named(true, false)),
            Line::list("equalities that are switched off", named(false, true)),
        ]
    }

    fn surroundings(&self) -> Line {
        let m = &self.medium;
        let ellipsoids = self.geoms.iter().filter(|g| g.fluid.is_some()).count();
        let shapes = match ellipsoids {
            0 => "every body as the box of its inertia".to_owned(),
            n => format!("{n} geoms as ellipsoids, other bodies as the boxes of their inertia"),
        };
        let text = format!("drag of a medium of {} kg/m^3 and {} Pa s with the wind {:?} m/s: {shapes}", m.density, m.viscosity, m.wind);
        Line::new(usize::from(m.acts()), text, "drag of air or water")
    }

    fn drives(&self) -> Vec<Line> {
        let names = |active: bool| {
            let chosen = self.actuators.iter().enumerate().filter(move |(_, a)| (a.activation != Activation::None) == active);
            chosen.map(|(i, a)| crate::label(&a.name, i))
        };
        let tendons = |has: fn(&crate::Tendon) -> bool| {
            self.tendons.iter().enumerate().filter(move |(_, t)| has(t)).map(|(i, t)| crate::label(&t.name, i))
        };
        vec![
            Line::list("actuators without activation", names(false)),
            Line::list("actuators with activation", names(true)),
            Line::list(
                "delays of controls",
                self.actuators.iter().enumerate().filter(|(_, a)| a.delay > 0.0).map(|(i, a)| crate::label(&a.name, i)),
            ),
            Line::list("fixed tendons", tendons(|_| true)),
            Line::list("limits of fixed tendons", tendons(|t| t.range.is_some())),
            Line::list(
                "springs, dampers and inertia of fixed tendons, implicit",
                tendons(|t| t.stiffness > 0.0 || t.damping > 0.0 || t.armature > 0.0),
            ),
            Line::list("dry friction in fixed tendons", tendons(|t| t.frictionloss > 0.0)),
        ]
    }

    fn readings(&self) -> Vec<Line> {
        let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
        self.sensors.iter().for_each(|s| *counts.entry(s.word()).or_default() += 1);
        let kinds: Vec<String> = counts.into_iter().map(|(word, n)| format!("{n} {word}")).collect();
        vec![
            Line::new(self.sensors.len(), format!("{} sensors: {}", self.sensors.len(), kinds.join(", ")), "sensors"),
            Line::list("keyframes", self.keyframes.iter().enumerate().map(|(i, k)| crate::label(&k.name, i))),
        ]
    }

    fn speed_limits(&self) -> Vec<String> {
        let limited = |j: &usize| self.joints[*j].velocity_limit.is_some();
        let names: Vec<String> = (0..self.joints.len()).filter(limited).map(|j| self.joint_label(j)).collect();
        let line = || {
            let (count, some) = (names.len(), short(names.iter()));
            format!("speed limits of {count} joints ({some}): model.jnt_velocity_limit has them, and the step does not enforce them")
        };
        (!names.is_empty()).then(line).into_iter().collect()
    }

    /// Lines of the report about omitted elements: first those that change the motion, then the others. Elements of the same kind with the
    /// same reason share a line.
    fn left_out(&self) -> (Vec<String>, Vec<String>) {
        let lines = |changes: bool| {
            let mut grouped: BTreeMap<(&str, &str), Vec<String>> = BTreeMap::new();
            for o in self.omitted.iter().filter(|o| o.changes_motion == changes) {
                grouped.entry((&o.kind, &o.reason)).or_default().push(o.name.clone());
            }
            grouped.into_iter().map(|((kind, reason), names)| format!("{kind} {}: {reason}", names.join(", "))).collect::<Vec<String>>()
        };
        (lines(true), [lines(false), self.speed_limits()].concat())
    }
}

/// Line of the report about a setting of the source file that the default options replace; `None` if they do not replace the setting. The
/// boolean is true if the source file contains the setting explicitly.
type Deviation = Option<(bool, String)>;

impl Requested {
    fn integrator_line(&self) -> Deviation {
        // A file without an integrator has MuJoCo's default, Euler's rule.
        let (express, name) = (self.integrator != "Euler", &self.integrator);
        let asked = if express { "asks for" } else { "has the default," };
        let line = format!("integrator: the source {asked} {name}, and midpoint runs. Options::from_model(&model) takes the source's");
        Some((express, line))
    }

    fn softness_line(&self) -> Deviation {
        if !self.constrained {
            return None;
        }
        let hard = "contacts, limits, equalities and dry friction are hard here: solref, solimp and impratio are not read, bodies do not sink in, \
                    limits do not give, and impacts stop at once; Options::from_model(&model) takes the source's law of contact";
        Some(match &self.soft[..] {
            [] => (false, format!("softness: MuJoCo's default, and {hard}")),
            soft => (true, format!("softness: the source gives solref or solimp to {}, and {hard}", soft.join("; "))),
        })
    }

    fn cone_line(&self) -> Deviation {
        let pyramid = self.cone.as_deref() == Some("pyramidal");
        let line = "friction cone: MuJoCo's default, a pyramid, which gives less friction between its edges, by up to 29 %; the exact circular \
                    cone runs by default";
        pyramid.then(|| (false, line.to_owned()))
    }
}

impl Verdict {
    const fn collides(self) -> bool {
        matches!(self, Self::Collides | Self::Explicit)
    }
}

/// Line of the report about a feature. If the scene has the feature (`present`), the text describes it; otherwise the text is the name of
/// the missing feature.
#[derive(Clone)]
struct Line {
    present: bool,
    text: String,
}

impl Line {
    fn new(count: usize, text: impl Into<String>, absent: impl Into<String>) -> Self {
        let present = count > 0;
        Self { present, text: if present { text.into() } else { absent.into() } }
    }

    fn list(what: &str, names: impl Iterator<Item = impl Display>) -> Self {
        let names: Vec<String> = names.map(|n| n.to_string()).collect();
        Self::new(names.len(), format!("{} {what}: {}", names.len(), short(names.iter())), what)
    }
}

/// Labels of the elements with indices 0 to `count` - 1 for which `has` returns true.
fn of<'a>(count: usize, has: &'a dyn Fn(usize) -> bool, label: &'a dyn Fn(usize) -> String) -> impl Iterator<Item = String> + 'a {
    (0..count).filter(move |&i| has(i)).map(label)
}

/// Text with the first names of a list, and the number of further names.
fn short(names: impl Iterator<Item = impl Display>) -> String {
    const SHOWN: usize = 12;
    let names: Vec<String> = names.map(|n| n.to_string()).collect();
    let more = if names.len() > SHOWN { format!(" and {} more", names.len() - SHOWN) } else { String::new() };
    names[..names.len().min(SHOWN)].join(", ") + &more
}

fn section(title: &str, lines: &[String]) -> String {
    let lines: String = if lines.is_empty() { "\n  nothing".into() } else { lines.iter().map(|l| format!("\n  {l}")).collect() };
    format!("{title}:{lines}")
}

#[cfg(test)]
mod tests {
    use super::super::finish::tests::{hollow, rich_model};
    use super::super::{BodyBuilder, GeomBuilder, JointBuilder, WORLD};
    use super::*;

    /// Lines of the report in the section `title`.
    fn lines<'a>(text: &'a str, title: &str) -> Vec<&'a str> {
        let start = text.find(&format!("\n{title}:")).unwrap_or_else(|| panic!("no section {title:?} in\n{text}"));
        let body = text[start + 1..].split("\n\n").next().unwrap();
        body.lines().skip(1).map(str::trim).collect()
    }

    fn has(lines: &[&str], part: &str) -> bool {
        lines.iter().any(|l| l.contains(part))
    }

    #[test]
    fn everything_modelled_is_named_and_counted() {
        let text = rich_model().explain();
        let modelled = lines(&text, "Modelled");
        for part in [
            "4 moving links",
            "1 bodies merged, as they cannot move against their parent: plate into arm",
            "1 bodies posed by the user: hand",
            "1 free joints",
            "geom pairs can collide",
            "belong to parent and child",
            "1 joint limits: shoulder",
            "1 joint springs: shoulder",
            "1 dry friction in joints: shoulder",
            "1 actuators with activation: servo",
            "1 actuators without activation: pull",
            "2 sensors: 1 jointpos, 1 jointvel",
        ] {
            assert!(has(&modelled, part), "{part:?} in\n{text}");
        }
        assert!(text.starts_with("rich: nq 13, nv 11, nu 2, na 1; 7 bodies"), "{text}");
    }

    #[test]
    fn pairs_add_up() {
        let model = rich_model();
        let census = model.pair_census();
        let n = model.geoms.len();
        assert_eq!(census.values().sum::<usize>(), n * (n - 1) / 2);
        let colliding: usize = census.iter().filter(|(v, _)| v.collides()).map(|(_, n)| n).sum();
        assert_eq!(colliding, model.collision_pairs().len());
    }

    #[test]
    fn what_a_scene_lacks_costs_nothing() {
        let mut scene = Model::builder("ball");
        scene.body(WORLD, BodyBuilder::new("ball").joint(JointBuilder::free("")).geom(GeomBuilder::sphere("", 0.1)));
        let text = scene.finish().unwrap().explain();
        let absent = lines(&text, "Costs nothing: this scene has no");
        assert!(["joint limits", "hinge joints", "restitution", "fixed tendons"].iter().all(|p| absent.contains(p)), "{text}");
        assert_eq!(lines(&text, "Left out, and the motion is different for it"), ["nothing"]);
        assert_eq!(lines(&text, "Beyond rigid bodies, whatever the scene").len(), BEYOND.len());
    }

    #[test]
    fn what_the_source_asks_for_and_does_not_get_comes_first() {
        const TITLE: &str = "The source asks for it, and by default something else runs";
        let mut model = rich_model();
        assert_eq!(lines(&model.explain(), TITLE), ["nothing"]);
        let cone = Some("pyramidal".to_owned());
        let (integrator, solver) = ("RK4".to_owned(), "Newton".to_owned());
        let soft = vec!["1 geom: ball".to_owned()];
        model.description.requested = Some(Requested { integrator, solver, iterations: 100, cone, constrained: true, soft });
        let text = model.explain();
        let found = lines(&text, TITLE);
        assert!(["asks for RK4, and midpoint runs", "1 geom: ball", "circular"].iter().all(|part| has(&found, part)), "{text}");
        assert_eq!(model.deviations(false).len(), 2);
    }

    #[test]
    fn omissions_are_told_apart() {
        let mut model = hollow();
        let sensor = |name: &str| super::super::Omission {
            kind: "sensor gyro".into(),
            name: name.into(),
            reason: "not read yet".into(),
            changes_motion: false,
        };
        model.omitted = vec![sensor("left"), sensor("right")];
        let text = model.finish(false).unwrap().explain();
        assert!(has(&lines(&text, "Left out, and the motion is different for it"), "collision rivet: "), "{text}");
        assert_eq!(lines(&text, "Left out, not counted as a change of the motion"), ["sensor gyro left, right: not read yet"]);
    }
}
