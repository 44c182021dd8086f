//! Report of a model as text: simulated elements, omitted elements with reasons, unused features, and phenomena that rigid-body simulation
//! does not cover.

use std::collections::BTreeMap;
use std::fmt::Display;

use crate::Kernel;
use crate::pairs::weld_groups;
use crate::{Activation, Actuator, Body, Equality, Joint, JointKind, Model, Pair, Requested, Tendon, Transmission, label};

/// Phenomena that rigid-body simulation does not model, in any scene.
const BEYOND: [&str; 7] = [
    "deformation: bodies and contacts are rigid; a contact area is represented by a few points, and stress, vibration and sound inside bodies do not exist",
    "impacts of finite duration: a collision is instantaneous, and one coefficient of restitution gives its loss of energy",
    "friction beyond Coulomb's law: no static peak, no dependence on speed, temperature, humidity, wear or lubrication",
    "flexible gears and links, backlash and play in joints, friction that depends on load",
    "flow of air and water (drag and lift, if any, are formulas of each body's own velocity), cables, cloth, soil and other soft matter",
    "motors and their electronics: heat, saturation, cogging, bus voltage, unless a parameter of the actuator includes them",
    "magnetism, electrostatics, and adhesion other than the actuators of this name",
];

impl Model {
    /// Report of the model as text. It lists simulated elements, omitted elements with reasons, features that the scene does not use, and
    /// phenomena that rigid-body simulation does not cover.
    pub fn explain(&self) -> String {
        let name = if self.name.is_empty() { "model" } else { &self.name };
        let [nq, nv, nu, na] = [self.nq(), self.nv(), self.nu(), self.na()];
        let [bodies, joints, geoms] = [self.bodies.len(), self.joints.len(), self.geoms.len()];
        let sizes = format!(
            "{name}: nq {nq}, nv {nv}, nu {nu}, na {na}; {bodies} bodies, {joints} joints, {geoms} geoms; time step {} s, gravity {:?} m/s^2",
            self.timestep, self.gravity
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
            section("Settings of the source that the default options replace", &self.deviations(true)),
            section("Modelled", &text(modelled)),
            section("Left out, which changes the motion", &changing),
            section("Left out, which does not change the motion", &harmless),
            section("Not in this scene, without cost", &text(absent)),
            section("Never simulated, because bodies are rigid", &BEYOND.map(String::from)),
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
            "noslip: the source sets noslip_iterations={sweeps}, which reduce the slip of soft friction; hard contact has no such slip and \
             ignores them. Options::from_model(&model) uses them"
        );
        (sweeps > 0).then_some((true, line))
    }

    fn links(&self) -> Vec<Line> {
        let (group, moves) = weld_groups(self);
        let merged = (1..self.bodies.len()).filter(|&b| group[b] != b);
        let merged: Vec<String> = merged.map(|b| format!("{} into {}", self.body_label(b), self.body_label(group[b]))).collect();
        let into = format!("bodies merged, because they cannot move relative to their parent: {}", short(&merged));
        vec![
            Line::new(moves.iter().filter(|m| **m).count(), "moving links", "moving links"),
            Line::new(merged.len(), into, "bodies to merge"),
            self.bodies_that("mocap bodies", |b| b.mocap),
        ]
    }

    fn joint_kinds(&self) -> Vec<Line> {
        let count = |kind| self.joints.iter().filter(|j| j.kind == kind).count();
        JointKind::ALL.map(|kind| Line::new(count(kind), format!("{} joints", kind.name()), format!("{} joints", kind.name()))).to_vec()
    }

    fn collision(&self) -> Vec<Line> {
        let census = self.pair_census();
        let total: usize = census.values().sum();
        let dropped: Vec<String> = census.iter().filter(|(v, _)| !v.collides()).map(|(v, n)| format!("{n} {}", v.name())).collect();
        let pairs = self.collision_pairs();
        let (kept, missing): (Vec<_>, Vec<_>) =
            pairs.iter().partition(|p| Kernel::of(&self.geoms[p.geoms[0]].shape, &self.geoms[p.geoms[1]].shape).is_some());
        let others = if dropped.is_empty() { String::new() } else { format!("; of the others {}", dropped.join(", ")) };
        let count = |has: fn(&Pair) -> bool| kept.iter().filter(|p| has(p)).count();
        let (slick, turning) = (count(|p| p.condim == 1), count(|p| p.condim > 3));
        let [rough_text, turning_text] = [
            "pairs with sliding friction: 3 rows per contact, the exact circular Coulomb cone",
            "pairs also with torsional friction (4 rows per contact) or rolling friction (6 rows): one elliptic cone",
        ];
        let sweeps = "noslip iterations at most with MuJoCo's contact law; hard contact ignores them";
        let missing_text = "more pairs would collide, but their shapes are left out (see below)";
        vec![
            Line::new(kept.len(), format!("of {total} geom pairs can collide{others}"), "pairs of geoms that can collide"),
            Line::new(missing.len(), missing_text, "collision pairs of shapes that are not simulated yet"),
            Line::new(kept.len() - slick - turning, rough_text, "friction"),
            Line::new(turning, turning_text, "torsional or rolling friction"),
            Line::new(self.soft.noslip.iterations as usize, sweeps, "noslip iterations"),
            Line::new(slick, "frictionless pairs: 1 row per contact", "frictionless contacts"),
            Line::new(count(|p| p.restitution > 0.0), "pairs bounce (Newton's restitution)", "restitution"),
            Line::new(count(|p| !p.spring.is_rigid()), "compliant pairs, with a spring and a damper (N/m, N s/m)", "contact stiffness"),
        ]
    }

    fn joint_forces(&self) -> Vec<Line> {
        let joints = |what, has: fn(&Joint) -> bool| Line::list(what, labels(&self.joints, |j| &j.name, has));
        vec![
            joints("joint limits", |j| j.range.is_some()),
            joints("joint springs", |j| j.stiffness != 0.0),
            joints("joint damping", |j| j.damping != 0.0),
            joints("rotor inertia", |j| j.armature != 0.0),
            joints("dry friction in joints", |j| j.frictionloss != 0.0),
            joints("limits of the sum of actuator forces on a joint (actuatorfrcrange)", |j| j.actuator_force_range.is_some()),
            self.surroundings(),
            self.bodies_that("bodies with gravity compensation", |b| b.gravcomp != 0.0),
            Line::list("geoms with a moving surface", labels(&self.geoms, |g| &g.name, |g| g.surface_velocity != [0.0; 6])),
        ]
    }

    fn bodies_that(&self, what: &str, has: fn(&Body) -> bool) -> Line {
        Line::list(what, labels(&self.bodies, |b| &b.name, has))
    }

    fn loops(&self) -> Vec<Line> {
        let named = |what, has: fn(&Equality) -> bool| {
            let chosen = self.equalities.iter().enumerate().filter(|(_, e)| has(e));
            Line::list(what, chosen.map(|(i, e)| format!("{} ({})", label(&e.name, i), e.kind.name())).collect())
        };
        vec![
            named("hard equalities", |e| e.active && e.stiffness.is_infinite()),
            named("soft equalities", |e| e.active && !e.stiffness.is_infinite()),
            named("inactive equalities", |e| !e.active),
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
        Line { present: m.acts(), text: if m.acts() { text } else { "drag of air or water".into() } }
    }

    fn drives(&self) -> Vec<Line> {
        let actuators = |what, has: fn(&Actuator) -> bool| Line::list(what, labels(&self.actuators, |a| &a.name, has));
        let tendons = |what, has: fn(&Tendon) -> bool| Line::list(what, labels(&self.tendons, |t| &t.name, has));
        vec![
            actuators("actuators without activation", |a| a.activation == Activation::None),
            actuators("actuators with activation", |a| a.activation != Activation::None),
            actuators("early activations (actearly)", |a| a.early),
            actuators("muscles", Actuator::is_muscle),
            actuators("adhesion: actuators that pull on the contacts of a body", |a| matches!(a.transmission, Transmission::Body(_))),
            actuators("delays of controls", |a| a.delay > 0.0),
            tendons("fixed tendons", |t| t.path.is_empty()),
            tendons("spatial tendons", |t| !t.path.is_empty()),
            tendons("limits of tendons", |t| t.range.is_some()),
            tendons("springs, dampers and inertia of tendons, implicit", |t| t.stiffness > 0.0 || t.damping > 0.0 || t.armature > 0.0),
            tendons("dry friction in tendons", |t| t.frictionloss > 0.0),
        ]
    }

    fn readings(&self) -> Vec<Line> {
        let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
        self.sensors.iter().for_each(|s| *counts.entry(s.word()).or_default() += 1);
        let kinds: Vec<String> = counts.into_iter().map(|(word, n)| format!("{n} {word}")).collect();
        vec![
            Line::new(self.sensors.len(), format!("sensors: {}", kinds.join(", ")), "sensors"),
            Line::list("keyframes", labels(&self.keyframes, |k| &k.name, |_| true)),
        ]
    }

    fn speed_limits(&self) -> Option<String> {
        let names = labels(&self.joints, |j| &j.name, |j| j.velocity_limit.is_some());
        let (count, some) = (names.len(), short(&names));
        let line =
            format!("speed limits of {count} joints ({some}): the step does not enforce them; model.jnt_velocity_limit has their values");
        (count > 0).then_some(line)
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
        (lines(true), lines(false).into_iter().chain(self.speed_limits()).collect())
    }
}

/// Line of the report about a setting of the source file that the default options replace; `None` if they do not replace the setting. The
/// boolean is true if the source file contains the setting explicitly.
type Deviation = Option<(bool, String)>;

impl Requested {
    /// Whether stepper has the integrator of the source file.
    fn has_integrator(&self) -> bool {
        ["Euler", "RK4", "implicit", "implicitfast"].contains(&self.integrator.as_str())
    }

    fn integrator_line(&self) -> Deviation {
        // A file without an integrator has MuJoCo's default, Euler's rule.
        let (express, name) = (self.integrator != "Euler", &self.integrator);
        let asked = if express { "sets" } else { "has the default," };
        let (lacks, remedy) = match self.has_integrator() {
            true => ("", ". Options::from_model(&model) uses the source's"),
            false => (", which stepper does not have", ""),
        };
        Some((express, format!("integrator: the source {asked} {name}{lacks}, and the default options use midpoint{remedy}")))
    }

    fn softness_line(&self) -> Deviation {
        if !self.constrained {
            return None;
        }
        let hard = "the default options make contacts, limits, equalities and dry friction hard: they ignore solref, solimp and impratio, bodies \
                    do not sink in, limits do not yield, and impacts end at once";
        let law = if self.has_integrator() { "; Options::from_model(&model) uses the source's contact law" } else { "" };
        Some(match &self.soft[..] {
            [] => (false, format!("softness: MuJoCo's default, and {hard}{law}")),
            soft => (true, format!("softness: the source sets solref or solimp of {}, and {hard}{law}", soft.join("; "))),
        })
    }

    fn cone_line(&self) -> Deviation {
        let pyramid = self.cone.as_deref() == Some("pyramidal");
        let line = "friction cone: the source has MuJoCo's default, a pyramid, whose friction is up to 29 % smaller between its edges; the default \
                    options use the exact circular cone";
        pyramid.then(|| (false, line.to_owned()))
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
    /// Line with the number and the text, or with the name of the missing feature if the number is 0.
    fn new(count: usize, text: impl Display, absent: impl Into<String>) -> Self {
        let present = count > 0;
        Self { present, text: if present { format!("{count} {text}") } else { absent.into() } }
    }

    fn list(what: &str, names: Vec<String>) -> Self {
        Self::new(names.len(), format!("{what}: {}", short(&names)), what)
    }
}

/// Labels of the elements for which `has` returns true.
fn labels<T>(elements: &[T], name: fn(&T) -> &str, has: fn(&T) -> bool) -> Vec<String> {
    elements.iter().enumerate().filter(|(_, element)| has(element)).map(|(i, element)| label(name(element), i)).collect()
}

/// Text with the first names of a list, and the number of further names.
fn short(names: &[String]) -> String {
    const SHOWN: usize = 12;
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
            "1 bodies merged, because they cannot move relative to their parent: plate into arm",
            "1 mocap bodies: hand",
            "1 free joints",
            "geom pairs can collide",
            "belong to a body and its parent",
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
        let absent = lines(&text, "Not in this scene, without cost");
        assert!(["joint limits", "hinge joints", "restitution", "fixed tendons"].iter().all(|p| absent.contains(p)), "{text}");
        assert_eq!(lines(&text, "Left out, which changes the motion"), ["nothing"]);
        assert_eq!(lines(&text, "Never simulated, because bodies are rigid").len(), BEYOND.len());
    }

    #[test]
    fn what_the_source_asks_for_and_does_not_get_comes_first() {
        const TITLE: &str = "Settings of the source that the default options replace";
        let mut model = rich_model();
        assert_eq!(lines(&model.explain(), TITLE), ["nothing"]);
        let cone = Some("pyramidal".to_owned());
        let (integrator, solver) = ("RK4".to_owned(), "Newton".to_owned());
        let soft = vec!["1 geom: ball".to_owned()];
        model.description.requested = Some(Requested { integrator, solver, iterations: 100, cone, constrained: true, soft });
        let text = model.explain();
        let found = lines(&text, TITLE);
        assert!(
            ["the source sets RK4, and the default options use midpoint", "1 geom: ball", "circular"].iter().all(|part| has(&found, part)),
            "{text}"
        );
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
        assert!(has(&lines(&text, "Left out, which changes the motion"), "collision rivet: "), "{text}");
        assert_eq!(lines(&text, "Left out, which does not change the motion"), ["sensor gyro left, right: not read yet"]);
    }
}
