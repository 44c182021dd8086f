//! Pairs of geoms that can collide, by the rules of MuJoCo 4.
//!
//! Two geoms collide if none of these filters drops them. Filters 4 to 6 do not apply to an explicit [`Pair`](crate::Pair) (MuJoCo
//! `engine_collision_driver.c`, `filterBodyPair` and `filterBitmask`; documentation, "Collision detection"):
//!
//! 1. both are fixed to the same rigid group, a body with everything welded to it (MuJoCo's `body_weldid`). A mocap body is a separate
//!    group, and everything fixed to the world is one group;
//! 2. no degree of freedom moves either of them;
//! 3. both are planes or height fields;
//! 4. one group is the parent of the other, unless the parent is the group of the world;
//! 5. their bodies are excluded;
//! 6. neither's `contype` shares a bit with the other's `conaffinity`.
//!
//! Excluded overlaps ([`Description::excluded_overlaps`]) are checked after filter 3, and drop explicit pairs too. Each names two geoms
//! that overlap in the reference pose, and excludes all pairs of their two bodies, like `<exclude>` in MJCF and `disable_collisions` in
//! SRDF. If one of the bodies is the world, only these two geoms are excluded.
//!
//! Margins and gaps of two geoms without an explicit pair are **sums** of those of the geoms. A gap is beyond the margin: a contact is
//! found within margin + gap, and pushes within margin (MuJoCo 4, `getMargin`, `getGap`, `mj_setContact`). MuJoCo 2 and 3 used the larger
//! of two margins, and contacts pushed within margin - gap. Measured with 4.0.0: geoms with margins of 0.05 and 0.02 m, and gaps of 0.03
//! and 0.01 m, rest at a distance of 0.07 m.

use std::cmp::Ordering;
use std::collections::{BTreeMap, HashSet};

use crate::softness::{ContactSpring, mixing_share};
use crate::{Description, Geom, Pair, Shape, Softness};

named! {
    /// Result of the collision filters for two geoms: either they collide, or one of the filters removes the pair.
    #[derive(PartialOrd, Ord)]
    pub(crate) enum Verdict {
        Collides = "can collide",
        Explicit = "collide by an explicit pair",
        SameGroup = "are fixed to the same rigid group",
        BothStill = "cannot move",
        Overlap = "overlap at the reference pose and are excluded",
        ParentAndChild = "belong to a body and its parent",
        Excluded = "are excluded",
        Masks = "have contype and conaffinity without a common bit",
        BothPlanesOrFields = "are both planes or height fields",
    }
}

impl Verdict {
    pub(super) const fn collides(self) -> bool {
        matches!(self, Self::Collides | Self::Explicit)
    }
}

/// Collision filter of a model: decides whether any two geoms collide, without a list of all pairs.
#[derive(Clone, Debug)]
pub struct Filter {
    tags: Vec<Tag>,
    /// Geoms of the model, which have the contact parameters.
    geoms: Vec<Geom>,
    pairs: Vec<Pair>,
    explicit: BTreeMap<[usize; 2], usize>,
    excluded: HashSet<[usize; 2]>,
    /// Pairs of bodies whose contacts are disabled by an excluded overlap. Each pair is stored in both orders. The world is never one of
    /// the bodies.
    overlapping_bodies: HashSet<[usize; 2]>,
    /// Pairs of geoms whose contacts are disabled by an excluded overlap, if one of the geoms belongs to the world body. Each pair is
    /// stored in both orders.
    overlapping_geoms: HashSet<[usize; 2]>,
}

/// Properties of a geom that the collision filters use.
#[derive(Clone, Debug)]
struct Tag {
    rank: u8,
    body: usize,
    /// Index of the rigid group that contains the geom's body. Bodies without joints between them form a rigid group.
    group: usize,
    /// Index of the parent group: the rigid group of the parent of this group's leading body.
    parent: usize,
    /// Whether the leading body of the rigid group has joints.
    moves: bool,
    masks: [u32; 2],
}

/// Rigid groups of bodies (MuJoCo's `body_weldid`): two lists with one entry for each body. The first has the index of the leading body of
/// the group, the second whether the body has joints.
///
/// Bodies with joints and mocap bodies lead a group; others belong to the group of their parent. The world leads the group of everything
/// that is fixed to it.
pub fn weld_groups(model: &Description) -> (Vec<usize>, Vec<bool>) {
    let mut moves = vec![false; model.bodies.len()];
    for joint in &model.joints {
        moves[joint.body] = true;
    }
    let mut group = vec![0; model.bodies.len()];
    for (i, body) in model.bodies.iter().enumerate().skip(1) {
        group[i] = if moves[i] || body.mocap { i } else { group[body.parent] };
    }
    (group, moves)
}

const fn rank(shape: &Shape) -> u8 {
    match shape {
        Shape::Plane => 0,
        Shape::HeightField { .. } => 1,
        Shape::Sphere { .. } => 2,
        Shape::Capsule { .. } => 3,
        Shape::Ellipsoid { .. } => 4,
        Shape::Cylinder { .. } => 5,
        Shape::Box { .. } => 6,
        Shape::Mesh { .. } => 7,
    }
}

impl Filter {
    /// Creates the collision filter of a description.
    pub fn new(model: &Description) -> Self {
        let (group, moves) = weld_groups(model);
        let tag = |g: &Geom| Tag {
            rank: rank(&g.shape),
            body: g.body,
            group: group[g.body],
            parent: group[model.bodies[group[g.body]].parent],
            moves: moves[group[g.body]],
            masks: [g.contype, g.conaffinity],
        };
        let tags = model.geoms.iter().map(tag).collect();
        let bodies = |geoms: [usize; 2]| geoms.map(|g| model.geoms[g].body);
        let overlaps = || model.excluded_overlaps.iter().map(|o| o.geoms);
        let without_world = overlaps().map(bodies).filter(|b| !b.contains(&0));
        let with_world = overlaps().filter(|&g| bodies(g).contains(&0));
        let mut filter = Self {
            tags,
            geoms: model.geoms.clone(),
            pairs: model.pairs.clone(),
            explicit: BTreeMap::new(),
            excluded: both_ways(model.excludes.iter().copied()),
            overlapping_bodies: both_ways(without_world),
            overlapping_geoms: both_ways(with_world),
        };
        for (k, pair) in model.pairs.iter().enumerate() {
            filter.explicit.entry(filter.ordered(pair.geoms)).or_insert(k);
        }
        filter
    }

    /// Colliding pairs with at least one geom for which `is_chosen` is true, each in the order of [`Filter::ordered`] and once. Their order
    /// is arbitrary.
    ///
    /// The search visits only pairs with a geom that moves, and the explicit pairs. A scene may have a hundred thousand fixed geoms.
    pub fn colliding(&self, is_chosen: impl Fn(usize) -> bool) -> Vec<[usize; 2]> {
        let has_masks = |&g: &usize| self.tags[g].masks != [0, 0];
        let (chosen, others): (Vec<usize>, Vec<usize>) = (0..self.tags.len()).filter(has_masks).partition(|&g| is_chosen(g));
        let [chosen, others] = [chosen, others].map(|geoms| geoms.into_iter().partition::<Vec<usize>, _>(|&g| self.tags[g].moves));
        let mut colliding = Vec::new();
        let mut visit = |first: &[usize], second: &[usize]| {
            for &a in first {
                let pairs = second.iter().map(|&b| self.ordered([a, b]));
                colliding.extend(pairs.filter(|&geoms| self.verdict(geoms) == Verdict::Collides));
            }
        };
        for k in 0..chosen.0.len() {
            visit(&chosen.0[k..=k], &chosen.0[k + 1..]);
        }
        visit(&chosen.0, &chosen.1);
        visit(&chosen.0, &others.0);
        visit(&chosen.0, &others.1);
        visit(&chosen.1, &others.0);
        let explicit = self.explicit().filter(|geoms| geoms.iter().any(|&g| is_chosen(g)));
        colliding.extend(explicit.filter(|&geoms| self.verdict(geoms) == Verdict::Explicit));
        colliding
    }

    /// Sorts two geoms into the order in which a [`Pair`] lists them. The simpler shape comes first (plane, height field, sphere, capsule,
    /// ellipsoid, cylinder, box, mesh). For equal shapes, the lower index comes first.
    #[inline]
    pub fn ordered(&self, [a, b]: [usize; 2]) -> [usize; 2] {
        let key = |g: usize| (self.tags[g].rank, g);
        if key(a) <= key(b) { [a, b] } else { [b, a] }
    }

    /// Result of the filters for two geoms, in the order of [`Filter::ordered`]: whether they collide, and if not, the first filter that
    /// removes the pair.
    pub(super) fn verdict(&self, geoms: [usize; 2]) -> Verdict {
        let [a, b] = geoms.map(|g| &self.tags[g]);
        if a.group == b.group {
            Verdict::SameGroup
        } else if !a.moves && !b.moves {
            Verdict::BothStill
        } else if b.rank <= 1 {
            Verdict::BothPlanesOrFields
        } else if self.overlapping_geoms.contains(&geoms) || self.overlapping_bodies.contains(&[a.body, b.body]) {
            Verdict::Overlap
        } else if self.explicit.contains_key(&geoms) {
            Verdict::Explicit
        } else if a.group != 0 && b.group != 0 && (a.group == b.parent || b.group == a.parent) {
            Verdict::ParentAndChild
        } else if self.excluded.contains(&[a.body, b.body]) {
            Verdict::Excluded
        } else if a.masks[0] & b.masks[1] == 0 && b.masks[0] & a.masks[1] == 0 {
            Verdict::Masks
        } else {
            Verdict::Collides
        }
    }

    /// Index of the explicit pair of two geoms; `None` if they have no explicit pair. The geoms are in the order of [`Filter::ordered`].
    pub fn explicit_pair(&self, geoms: [usize; 2]) -> Option<usize> {
        self.explicit.get(&geoms).copied()
    }

    /// Indices of the two geoms of each explicit pair, in the order of [`Filter::ordered`].
    pub fn explicit(&self) -> impl Iterator<Item = [usize; 2]> + '_ {
        self.explicit.keys().copied()
    }

    /// Comparison of the priorities of two geoms without an explicit pair (`Greater` if the first has the higher priority), and dimension
    /// (condim) of their contact.
    ///
    /// The geom with the higher priority determines friction and dimension; with equal priorities the larger values apply.
    #[inline(always)]
    pub fn precedence(&self, geoms: [usize; 2]) -> (Ordering, u8) {
        precedence(geoms.map(|g| &self.geoms[g]))
    }

    /// Whether a contact of two geoms without an explicit pair is rigid: neither surface has a spring.
    #[inline(always)]
    pub fn is_rigid(&self, [a, b]: [usize; 2]) -> bool {
        self.geoms[a].spring.is_rigid() && self.geoms[b].spring.is_rigid()
    }

    /// Contact parameters of two geoms; `None` if the geoms do not collide. The geoms are in the order of [`Filter::ordered`].
    pub fn pair(&self, geoms: [usize; 2]) -> Option<Pair> {
        match self.verdict(geoms) {
            Verdict::Collides => Some(mix(geoms, geoms.map(|g| &self.geoms[g]))),
            Verdict::Explicit => {
                let p = &self.pairs[self.explicit[&geoms]];
                Some(Pair { name: String::new(), geoms, restitution: bounce(p.spring, p.restitution), ..p.clone() })
            }
            _ => None,
        }
    }
}

fn both_ways(pairs: impl Iterator<Item = [usize; 2]>) -> HashSet<[usize; 2]> {
    pairs.flat_map(|[a, b]| [[a, b], [b, a]]).collect()
}

/// Comparison of the priorities of two geoms without an explicit pair, and dimension (condim) of their contact (MuJoCo `mj_contactParam`).
/// The comparison is `Greater` if the first geom has the higher priority. The geom with the higher priority determines the dimension; with
/// equal priorities the larger dimension applies.
fn precedence([a, b]: [&Geom; 2]) -> (Ordering, u8) {
    let order = a.priority.cmp(&b.priority);
    let condim = match order {
        Ordering::Greater => a.condim,
        Ordering::Less => b.condim,
        Ordering::Equal => a.condim.max(b.condim),
    };
    (order, condim)
}

/// Coefficient of restitution of a contact. It is 0 for a compliant contact, whose spring and damper determine the rebound.
fn bounce(spring: ContactSpring, restitution: f64) -> f64 {
    if spring.is_rigid() { restitution } else { 0.0 }
}

/// Combines the contact parameters of two geoms without an explicit pair. The geom with the higher priority determines the friction; with
/// equal priorities each coefficient is the larger of the two. Restitution is the larger of the two, whatever the priorities.
fn mix(geoms: [usize; 2], [a, b]: [&Geom; 2]) -> Pair {
    let (order, condim) = precedence([a, b]);
    let (friction, softness) = match order {
        Ordering::Greater => (a.friction, a.softness),
        Ordering::Less => (b.friction, b.softness),
        Ordering::Equal => {
            let share = mixing_share([a.solmix, b.solmix]);
            (std::array::from_fn(|k| a.friction[k].max(b.friction[k])), Softness::mix(a.softness, b.softness, share))
        }
    };
    let spring = ContactSpring::in_series([a.spring, b.spring]);
    let restitution = bounce(spring, a.restitution.max(b.restitution));
    let (margin, gap, anisotropy) = (a.margin + b.margin, a.gap + b.gap, [1.0; 2]);
    Pair { geoms, condim, friction, restitution, margin, gap, softness, anisotropy, spring, ..Pair::default() }
}

impl Description {
    /// Pairs of geoms that can collide, by the filters at the head of `pairs.rs`, in ascending order of the geom indices. If two explicit
    /// pairs have the same geoms, the first one applies.
    pub fn collision_pairs(&self) -> Vec<Pair> {
        let filter = Filter::new(self);
        let mut geoms = filter.colliding(|_| true);
        geoms.sort_unstable();
        geoms.into_iter().filter_map(|geoms| filter.pair(geoms)).collect()
    }

    /// Number of geom pairs for each result of the filters.
    pub(super) fn pair_census(&self) -> BTreeMap<Verdict, usize> {
        let filter = Filter::new(self);
        let (moving, still): (Vec<usize>, Vec<usize>) = (0..filter.tags.len()).partition(|&g| filter.tags[g].moves);
        let mut census = BTreeMap::new();
        for (k, &a) in moving.iter().enumerate() {
            for &b in moving[k + 1..].iter().chain(&still) {
                *census.entry(filter.verdict(filter.ordered([a, b]))).or_insert(0) += 1;
            }
        }
        let number_of_pairs = |n: usize| n * n.saturating_sub(1) / 2;
        let mut groups = BTreeMap::new();
        still.iter().for_each(|&g| *groups.entry(filter.tags[g].group).or_insert(0) += 1);
        let of_one_group: usize = groups.into_values().map(number_of_pairs).sum();
        let of_two_groups = number_of_pairs(still.len()) - of_one_group;
        for (verdict, count) in [(Verdict::SameGroup, of_one_group), (Verdict::BothStill, of_two_groups)] {
            if count > 0 {
                *census.entry(verdict).or_insert(0) += count;
            }
        }
        census
    }
}

#[cfg(test)]
mod tests {
    use super::super::{BodyBuilder, GeomBuilder, JointBuilder, Model, ModelBuilder, WORLD};
    use super::*;

    fn ball(name: &str) -> GeomBuilder {
        GeomBuilder::sphere(name, 0.1)
    }

    /// Scene with a floor, an arm and a mocap hand. The arm has a ball, a plate with a ball welded to it, and a lower arm with a ball on a
    /// hinge. A ball hangs from the hand by a ball joint.
    fn scene() -> ModelBuilder {
        let mut scene = Model::builder("filters");
        scene.geom(WORLD, GeomBuilder::plane("floor"));
        let arm = scene.body(WORLD, BodyBuilder::new("arm").joint(JointBuilder::hinge("shoulder", [0.0, 1.0, 0.0])).geom(ball("upper")));
        scene.body(arm, BodyBuilder::new("plate").geom(ball("welded")));
        scene.body(arm, BodyBuilder::new("lower").joint(JointBuilder::hinge("elbow", [0.0, 1.0, 0.0])).geom(ball("lower")));
        let hand = scene.body(WORLD, BodyBuilder::new("hand").mocap().geom(ball("hand")));
        scene.body(hand, BodyBuilder::new("bob").joint(JointBuilder::ball("string")).geom(ball("bob")));
        scene
    }

    fn names(model: &Model) -> Vec<[&str; 2]> {
        model.collision_pairs().iter().map(|p| p.geoms.map(|g| model.geoms[g].name.as_str())).collect()
    }

    #[test]
    fn filters_are_those_of_mujoco() {
        let model = scene().finish().unwrap();
        let expected = [
            ["floor", "upper"],
            ["floor", "welded"],
            ["floor", "lower"],
            ["floor", "bob"],
            ["upper", "hand"],
            ["upper", "bob"],
            ["welded", "hand"],
            ["welded", "bob"],
            ["lower", "hand"],
            ["lower", "bob"],
        ];
        assert_eq!(names(&model), expected);
        let census = model.pair_census();
        assert_eq!(census.values().sum::<usize>(), 15);
        assert_eq!(census[&Verdict::ParentAndChild], 3, "upper-lower, welded-lower, hand-bob");
        assert_eq!((census[&Verdict::SameGroup], census[&Verdict::BothStill]), (1, 1));
    }

    #[test]
    fn explicit_pairs_bypass_filters_and_excludes_drop() {
        let mut scene = scene();
        scene.exclude("arm", "hand").pair("lower", "upper", [0.3, 0.0, 0.0]);
        let model = scene.finish().unwrap();
        let found = names(&model);
        assert!(found.contains(&["upper", "lower"]) && !found.contains(&["upper", "hand"]) && found.contains(&["welded", "hand"]));
        let pairs = model.collision_pairs();
        assert!(pairs.windows(2).all(|w| w[0].geoms < w[1].geoms));
        assert_eq!(pairs.iter().find(|p| p.geoms == [1, 3]).unwrap().friction[0], 0.3);
    }

    #[test]
    fn masks_meet_one_way() {
        let mut scene = Model::builder("masks");
        scene.geom(WORLD, GeomBuilder::plane("floor").masks(2, 0));
        let free = |name: &str| BodyBuilder::new(name).joint(JointBuilder::free(""));
        scene.body(WORLD, free("a").geom(ball("a").masks(0, 2)));
        scene.body(WORLD, free("b").geom(ball("b").masks(1, 1)));
        assert_eq!(names(&scene.finish().unwrap()), [["floor", "a"]]);
    }

    #[test]
    fn parameters_combine() {
        let mut scene = Model::builder("mix");
        scene.geom(WORLD, GeomBuilder::plane("floor").friction([0.5, 0.02, 0.0]).condim(1).margin(0.05).gap(0.03).restitution(0.5));
        let free = |name: &str| BodyBuilder::new(name).joint(JointBuilder::free(""));
        let plain = ball("plain").friction([1.0, 0.01, 0.0]).margin(0.02).gap(0.01).restitution(0.2);
        scene.body(WORLD, free("plain").geom(plain));
        scene.body(WORLD, free("first").geom(ball("first").priority(1).friction([0.1, 0.0, 0.0]).condim(3)));
        let pairs = scene.finish().unwrap().collision_pairs();
        assert_eq!((pairs[0].condim, pairs[0].friction, pairs[0].restitution), (3, [1.0, 0.02, 0.0], 0.5));
        assert_eq!((pairs[0].margin, pairs[0].gap), (0.05 + 0.02, 0.03 + 0.01));
        assert_eq!((pairs[1].condim, pairs[1].friction), (3, [0.1, 0.0, 0.0]));
    }

    #[test]
    fn simpler_shape_comes_first() {
        let mut scene = Model::builder("order");
        let free = |name: &str| BodyBuilder::new(name).joint(JointBuilder::free(""));
        scene.body(WORLD, free("a").geom(GeomBuilder::capsule("capsule", 0.1, 0.2)));
        scene.body(WORLD, free("b").geom(ball("sphere")));
        assert_eq!(names(&scene.finish().unwrap()), [["sphere", "capsule"]]);
    }
}
