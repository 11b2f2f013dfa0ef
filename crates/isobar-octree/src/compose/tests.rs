//! Compositions against integers: every form is a sum of products, so on integers it must be exact.
//!
//! All forms run on [`Counted`] numbers here: their operations are calls. Inlined, with their checks for overflow, they take a minute to compile.

use super::*;

/// splitmix64.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }
    /// In [-m, m].
    fn int(&mut self, m: u64) -> i128 {
        i128::from(self.next() % (2 * m + 1)) - i128::from(m)
    }
    fn unit(&mut self) -> f32 {
        (self.next() >> 40) as f32 / (1 << 24) as f32
    }
}

/// f at a point, by definition: power form, or scaled Bernstein form.
fn value<const D: usize>(f: &[i128], p: [i128; 3], scaled: bool) -> i128 {
    let basis = |x: i128, i: usize| {
        let other = if scaled { (1 - x).pow((D - i) as u32) } else { 1 };
        x.pow(i as u32) * other
    };
    let mut sum = 0;
    for i in 0..=D {
        for j in 0..=D {
            for k in 0..=D {
                sum += f[at::<D>(i, j, k)] * basis(p[0], i) * basis(p[1], j) * basis(p[2], k);
            }
        }
    }
    sum
}

/// The univariate polynomial at t.
fn along(a: &[i128], t: i128, scaled: bool) -> i128 {
    let n = a.len() - 1;
    (0..=n)
        .map(|i| a[i] * t.pow(i as u32) * if scaled { (1 - t).pow((n - i) as u32) } else { 1 })
        .sum()
}

fn counted_all<T: Copy>(numbers: &[T]) -> Vec<Counted<T>> {
    numbers.iter().map(|&x| Counted(x)).collect()
}

/// Coefficients along a ray in `form`.
fn composed<T: Scalar, const D: usize>(form: Form, f: &[T], r: &[[T; 2]; 3]) -> Vec<T> {
    // What is not written shows.
    let unwritten = Counted(T::ONE + T::ONE);
    let mut out = vec![unwritten; 3 * D + 1];
    compose::<_, D>(form, &counted_all(f), &r.map(|c| c.map(Counted)), &mut out);
    out.into_iter().map(|c| c.0).collect()
}

fn exact<const D: usize>() {
    let mut random = Random(D as u64);
    for _ in 0..50 {
        let f: Vec<i128> = (0..(D + 1).pow(3)).map(|_| random.int(1000)).collect();
        let r: [[i128; 2]; 3] = std::array::from_fn(|_| [random.int(9), random.int(9)]);
        for form in Form::ALL {
            let out = composed::<i128, D>(form, &f, &r);
            let (takes_scaled, gives_scaled) = match form.basis() {
                Basis::Power => (false, false),
                Basis::ScaledBernstein => (true, true),
                Basis::PowerToScaledBernstein => (false, true),
            };
            // More places than a polynomial of that degree has coefficients: equal there means equal.
            for t in -6..6 {
                let along_pair = |[a, b]: [i128; 2], scaled: bool| if scaled { a * (1 - t) + b * t } else { a + b * t };
                let point = match form {
                    Form::Axis => [along_pair(r[0], false), along_pair(r[1], false), t],
                    Form::AxisSegment => {
                        let z = along_pair(r[2], true);
                        [r[0][0] + r[0][1] * z, r[1][0] + r[1][1] * z, z]
                    }
                    _ => r.map(|c| along_pair(c, takes_scaled)),
                };
                assert_eq!(
                    along(&out, t, gives_scaled),
                    value::<D>(&f, point, takes_scaled),
                    "{} D = {D} t = {t}",
                    form.name()
                );
            }
        }
    }
}

#[test]
fn every_form_is_exact_on_integers() {
    exact::<1>();
    exact::<2>();
    exact::<3>();
}

fn counted<const D: usize>(form: Form) -> (u64, u64) {
    let one = Counted(1.0f32);
    let f = vec![one; (D + 1).pow(3)];
    let mut out = vec![one; 3 * D + 1];
    let done = count(|| compose::<_, D>(form, &f, &[[one; 2]; 3], &mut out));
    (done.multiplications, done.additions)
}

/// What Table 3.1 prints for degree 3, where counting says the same; and where it does not, what counting says.
#[test]
fn operations_of_table_3_1() {
    // PF's rows are exchanged in print; SB2's are those of three precomputed sums.
    assert_eq!(counted::<3>(Form::Pf), (360, 234));
    assert_eq!(counted::<3>(Form::Sb0), (741, 483));
    assert_eq!(counted::<3>(Form::Sb3), (720, 558));
    assert_eq!(counted::<3>(Form::Sb1), (687 - 4, 490));
    assert_eq!(counted::<3>(Form::Sb2), (697, 533));
    // 1000 terms onto 10 coefficients, and the binomial coefficients 2 and 3 by addition
    assert_eq!(counted::<3>(Form::Naive).1, 990 + 3 * 5);
    // The recommended one: PF without its innermost sum, 16 times 12 multiplications and 6 additions.
    assert_eq!(counted::<3>(Form::Axis), (168, 138));
    for form in Form::ALL {
        let (m, a) = counted::<3>(form);
        assert!(form == Form::Axis || m + a > 168 + 138, "{}", form.name());
    }
}

#[test]
fn f32_and_f64_agree_to_rounding() {
    let mut random = Random(7);
    for form in Form::ALL {
        let f: Vec<f32> = (0..64).map(|_| 2.0 * random.unit() - 1.0).collect();
        let r: [[f32; 2]; 3] = std::array::from_fn(|_| [random.unit(), random.unit()]);
        let narrow = composed::<f32, 3>(form, &f, &r);
        let f: Vec<f64> = f.iter().map(|x| f64::from(*x)).collect();
        let wide = composed::<f64, 3>(form, &f, &r.map(|c| c.map(f64::from)));
        let most = wide.iter().fold(0.0f64, |m, x| m.max(x.abs()));
        for (a, b) in narrow.iter().zip(wide) {
            assert!((f64::from(*a) - b).abs() < 1e-5 * most, "{}: {a} {b}", form.name());
        }
    }
}

#[test]
fn packets_agree_with_single_rays_bit_for_bit() {
    fn run<const D: usize>() {
        let mut random = Random(11);
        let (n, m) = ((D + 1).pow(3), 3 * D + 1);
        let cells: Vec<Lanes<WIDTH>> = (0..2 * n)
            .map(|_| Lanes(std::array::from_fn(|_| 2.0 * random.unit() - 1.0)))
            .collect();
        let mut lanes = || Lanes(std::array::from_fn(|_| random.unit()));
        let mut pair = || [lanes(), lanes()];
        let packets: Vec<Packet<'_>> = (cells.chunks(n))
            .map(|cells| Packet {
                cells,
                rays: [pair(), pair()],
                stretch: pair(),
            })
            .collect();
        for (form, compose_packets) in [
            (Form::Axis, axis_packets::<D> as fn(_, &[Packet<'_>], &mut [_])),
            (Form::AxisSegment, axis_segment_packets::<D>),
        ] {
            for level in isobar_cpu::Level::ALL {
                let mut out = vec![Lanes::splat(f32::NAN); 2 * m];
                compose_packets(level, &packets, &mut out);
                for (p, out) in packets.iter().zip(out.chunks(m)) {
                    for lane in 0..WIDTH {
                        let f: Vec<f32> = p.cells.iter().map(|c| c.0[lane]).collect();
                        let r = [p.rays[0], p.rays[1], p.stretch].map(|r| r.map(|c| c.0[lane]));
                        let want = composed::<f32, D>(form, &f, &r);
                        let got: Vec<f32> = out.iter().map(|c| c.0[lane]).collect();
                        assert_eq!(got, want, "{} D = {D} {level} lane {lane}", form.name());
                    }
                }
            }
        }
    }
    run::<1>();
    run::<2>();
    run::<3>();
}
