//! Numbers that the thesis prints, copied from it (paper-numbers: Steinberger2010). Its machine is a Core i7 with a GeForce GTX 285; none is scaled to another.

/// Figure 3.2, Bucky, a view that is not given: blocks of 8 x 8 pixels that end at the box, meet no candidate voxel, and work on polynomials.
pub const FIGURE_3_2: [(&str, usize); 3] = [
    ("finished at the box", 752),
    ("no candidate voxel", 799),
    ("root finding", 1050),
];

/// Table 6.1, per cent of a frame: stages by degree. Stages are [`crate::comparators::algebraic::STAGES`].
pub const TABLE_6_1: [[f64; 3]; 7] = [
    [8.390, 0.903, 0.187],
    [6.936, 0.743, 0.141],
    [6.090, 0.676, 0.139],
    [3.941, 1.823, 1.029],
    [71.017, 93.551, 97.489],
    [1.546, 1.732, 0.972],
    [2.079, 0.571, 0.042],
];

/// Table 6.2, frames per second at 1024x768: data set, its figure, then tri-linear, tri-square, tri-cubic, and texture sampling over the same octree.
pub const TABLE_6_2: [(&str, &str, [f64; 4]); 4] = [
    ("Bucky 32³", "6.2", [31.2, 16.3, 7.1, 29.8]),
    ("Dragon 128³", "6.3", [9.8, 6.9, 4.6, 18.3]),
    ("Foot 256³", "6.4", [4.6, 2.8, 1.5, 12.0]),
    ("Vertebra 512³", "6.5", [6.6, 5.3, 3.5, 4.7]),
];

/// Table 6.3 (a), milliseconds at 1024x768: data set, then five stages (set-up, traversal, composition and loading, root finding, normals and storing) by degree.
pub const TABLE_6_3: [(&str, [[f64; 3]; 5]); 4] = [
    (
        "Bucky 32³",
        [
            [0.40, 0.39, 0.41],
            [21.96, 32.95, 40.47],
            [5.46, 21.92, 75.55],
            [0.62, 6.30, 22.29],
            [0.21, 2.32, 10.56],
        ],
    ),
    (
        "Dragon 128³",
        [
            [0.40, 0.40, 0.39],
            [54.06, 92.94, 114.9],
            [2.51, 11.88, 41.44],
            [0.67, 4.52, 21.58],
            [0.41, 2.90, 17.78],
        ],
    ),
    (
        "Foot 256³",
        [
            [0.40, 0.39, 0.40],
            [100.2, 205.0, 224.0],
            [3.85, 22.22, 67.16],
            [1.26, 6.73, 23.48],
            [0.71, 4.34, 22.58],
        ],
    ),
    (
        "Vertebra 512³",
        [
            [0.42, 0.42, 0.42],
            [98.64, 173.6, 214.1],
            [4.33, 20.11, 64.23],
            [0.77, 4.53, 17.24],
            [0.37, 2.50, 15.74],
        ],
    ),
];

/// What Table 6.4 prints for a rendering of Figure 6.7.
#[derive(Debug, Clone, Copy)]
pub struct Printed64 {
    /// Figure 6.7's letter.
    pub figure: &'static str,
    /// Active chunks, and their share of all in percent.
    pub chunks: (u32, f64),
    /// Milliseconds of the reconstruction and of the frame.
    pub times: [f64; 2],
    /// Mean squared error over coloured pixels, times 1000.
    pub mse: f64,
}

/// Table 6.4, dragon 128³.
pub const TABLE_6_4: [Printed64; 6] = [
    printed("full", (4681, 100.0), [7.23, 225.0], 0.0),
    printed("b", (3421, 73.0), [8.72, 219.0], 24.0),
    printed("c", (1877, 40.0), [9.25, 161.0], 45.0),
    printed("d", (585, 12.0), [6.11, 115.0], 57.0),
    printed("e", (295, 6.0), [6.92, 89.3], 176.0),
    printed("f", (73, 1.6), [3.58, 61.4], 370.0),
];

const fn printed(figure: &'static str, chunks: (u32, f64), times: [f64; 2], mse: f64) -> Printed64 {
    Printed64 {
        figure,
        chunks,
        times,
        mse,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The shares of Table 6.4 follow from its counts, of 4681 chunks.
    #[test]
    fn shares_follow_from_the_counts() {
        for p in TABLE_6_4 {
            let share = 100.0 * f64::from(p.chunks.0) / 4681.0;
            assert!((share - p.chunks.1).abs() < 0.6, "{p:?}: {share}");
        }
    }

    /// The columns of Table 6.1 are parts of a whole.
    #[test]
    fn shares_of_table_6_1_sum_to_a_hundred() {
        for degree in 0..3 {
            let all: f64 = TABLE_6_1.iter().map(|s| s[degree]).sum();
            assert!((all - 100.0).abs() < 0.01, "degree {}: {all}", degree + 1);
        }
    }

    /// The relative half of Table 6.3 follows from the absolute one: the copies hold together.
    #[test]
    fn shares_follow_from_the_times() {
        // Table 6.3 (b): traversal, percent.
        let shares = [
            [76.65, 51.58, 27.11],
            [93.11, 82.51, 58.61],
            [94.16, 85.89, 66.35],
            [94.37, 86.31, 68.69],
        ];
        for ((name, stages), shares) in TABLE_6_3.iter().zip(shares) {
            for (degree, share) in shares.iter().enumerate() {
                let whole: f64 = stages.iter().map(|s| s[degree]).sum();
                let found = 100.0 * stages[1][degree] / whole;
                assert!((found - share).abs() < 0.06, "{name}, degree {}: {found}", degree + 1);
            }
        }
    }

    /// 752, 799 and 1050 blocks are the 29, 31 and 40 per cent of the caption.
    #[test]
    fn shares_of_figure_3_2_are_those_of_its_caption() {
        let all: usize = FIGURE_3_2.iter().map(|b| b.1).sum();
        let shares = FIGURE_3_2.map(|b| (100.0 * b.1 as f64 / all as f64).round() as usize);
        assert_eq!(shares, [29, 31, 40]);
    }
}
