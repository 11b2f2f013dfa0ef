use super::*;

fn definition(text: &str) -> Definition {
    let mut d: Definition = toml::from_str(text).unwrap();
    d.id = "test".into();
    d.group = "curated".into();
    d
}

fn settings(stage: &Path) -> Settings {
    Settings {
        root: stage.to_path_buf(),
        stage: stage.to_path_buf(),
        truths: stage.join("truths"),
        full: false,
    }
}

/// A small scene end to end: verified rows, pictures, models, and failures where the definition demands something else.
#[test]
fn a_small_scene_is_measured_and_verified() {
    let dir = tempfile::tempdir().unwrap();
    let d = definition(
        "title='Sphere'\ndata='synthetic:sphere,n=24'\nisovalues=[1]\nview='bench'\nsize=[48,36]\nanalysis='a'\n\
         [sweep]\n'march/*'=['step=4','step=0.5']\n[expect.trilinear]\nhits=1",
    );
    let s = scene(
        &d,
        &[isobar::method("march/cpu").unwrap()],
        &settings(dir.path()),
        &Stop::default(),
    )
    .unwrap();
    assert_eq!(s.skipped, None);
    let c = &s.comparisons[0];
    assert_eq!(c.rows.len(), 2);
    assert!(
        c.rows
            .iter()
            .all(|r| r.reason.is_none() && r.wall.n >= 1 && r.wall.median > 0.0)
    );
    let default = c.rows.iter().find(|r| r.default).unwrap();
    assert_eq!(default.setting, "step=0.5");
    assert!(default.checked.hits > 300 && default.checked.pixels == 48 * 36);
    assert!(default.checked.t_voxels.max < 0.5, "{:?}", default.checked);
    assert!(
        c.failures.iter().any(|f| f.contains("the definition demands 1")),
        "{:?}",
        c.failures
    );
    // A trilinear function is its samples.
    assert!(c.rows.iter().all(|r| r.storage.is_some_and(|s| s.same) && r.peak.is_none()));
    let p = &c.pictures[0];
    for file in [&p.image, &p.error, &p.work] {
        assert!(dir.path().join(file).is_file(), "{file}");
    }
    let measured: Vec<&str> = c
        .models
        .iter()
        .filter(|m| m.reason.is_none())
        .map(|m| m.model.as_str())
        .collect();
    for model in ["open", "data", "isovalue", "view", "steady", "read"] {
        assert!(measured.contains(&model), "{model}: {:?}", c.models);
    }
}

/// An interpolating spline is drawn from coefficients in f32: the report says how far that moves the surface.
#[test]
fn the_storage_error_is_measured() {
    let dir = tempfile::tempdir().unwrap();
    let d = definition(
        "title='Torus'\ndata='synthetic:torus,n=24'\nisovalues=[0]\nview='bench'\nsize=[48,36]\nanalysis='a'\n\
         reconstructions=['cubic-interpolating']\nmethods=['octree/cpu']",
    );
    let s = scene(&d, &isobar::methods(), &settings(dir.path()), &Stop::default()).unwrap();
    let row = &s.comparisons[0].rows[0];
    let storage = row.storage.expect("the method tells both functions");
    assert!(!storage.same && storage.compared > 200 && storage.changed == 0, "{storage:?}");
    assert!(storage.voxels.median > 0.0 && storage.voxels.max < 1e-3, "{storage:?}");
    assert_eq!(row.method, "octree/cpu");
    let stages = s.comparisons[0].stages.expect("its frames are clocked, and right");
    assert!(
        stages.iter().all(|t| t.is_finite() && *t >= 0.0) && stages.iter().sum::<f64>() > 0.0,
        "{stages:?}"
    );
}

/// A medium is held against the exact colours, by peaks/* also against the exact peaks; tetrahedra need no reconstruction.
#[test]
fn media_are_compared_by_colour() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(
        dir.path().join("m.toml"),
        "points = [[0.5, 1.0, 0.5, 0.1, 0.0], [1.0, 1.0, 0.5, 0.1, 0.05], [1.5, 0.1, 0.5, 1.0, 0.0]]",
    )
    .unwrap();
    let measured = |data: &str, reconstruction: &str, method: &str, setting: &str| {
        let d = definition(&format!(
            "title='x'\ndata='synthetic:sphere,n=16{data}'\nmedium='m.toml'\nview='bench'\nsize=[32,24]\nanalysis='a'\n\
             reconstructions=['{reconstruction}']\nmethods=['{method}']\n[sweep]\n'{method}'=['{setting}']"
        ));
        let s = scene(&d, &isobar::methods(), &settings(dir.path()), &Stop::default()).unwrap();
        assert_eq!(s.skipped, None);
        s.comparisons.into_iter().next().unwrap()
    };
    let c = measured("", "trilinear", "peaks/cpu", "mode=default");
    let k = c.rows[0].colour.expect("a medium has colours");
    let peaks = k.peaks.expect("peaks/cpu draws them");
    assert!(k.surfaces && c.truth.hits > 100 && c.rows[0].checked.wrong() == 0, "{k:?}");
    // Seen: 7e-4 and 9e-3.
    let max = |a: crate::results::Apart| a.max.expect("a number");
    assert!(max(peaks) < 2e-3 && max(k.integral) > 5e-3, "{k:?}");
    let bias = max(k.bias.expect("both exact images are there"));
    assert!(
        (bias - max(k.integral)).abs() < 2e-3 && k.bound.is_some_and(|b| b < 1e-6),
        "{k:?}"
    );
    assert!(c.models.is_empty() && !c.pictures[0].error.is_empty());

    // The medium alone has no peaks to miss; peaks alone have an exact image of their own.
    let c = measured("", "trilinear", "peaks/cpu-paper", "mode=dvr_only");
    let row = c.rows.iter().find(|r| r.setting == "mode=dvr_only").unwrap();
    let k = row.colour.expect("a medium has colours");
    assert!(!k.surfaces && k.peaks.is_none() && row.checked.hits == 0, "{row:?}");
    assert!(c.truth.hits > 100, "those of the default setting");
    let c = measured("", "trilinear", "peaks/cpu", "mode=peak_only");
    let row = c.rows.iter().find(|r| r.setting == "mode=peak_only").unwrap();
    let k = row.colour.expect("a medium has colours");
    assert!(
        k.peaks.is_some_and(|a| max(a) < 1e-4) && k.bias.is_none() && row.checked.wrong() == 0,
        "{k:?}"
    );

    let c = measured(",as=tets", "linear", "cellproj/cpu", "integration=exact");
    let exact = c.rows.iter().find(|r| r.setting == "integration=exact").unwrap();
    let k = exact.colour.expect("a medium has colours");
    assert!(!k.surfaces && k.peaks.is_none() && max(k.integral) < 1e-5, "{k:?}");
    assert!(k.integral.visible == 0 && c.pictures[0].error.is_empty(), "{:?}", c.pictures);
}

#[test]
fn stored_results_come_back_as_they_were() {
    let mut row = Row {
        colour: Some(Colour::default()),
        ..Row::default()
    };
    for x in [None, Some(0.25)] {
        row.colour = row.colour.map(|mut c| {
            (c.integral.max, c.integral.psnr, c.bound) = (x, x, x);
            c
        });
        let text = serde_json::to_string(&row).unwrap();
        assert_eq!(serde_json::from_str::<Row>(&text).unwrap(), row);
    }
}

#[test]
fn scenes_without_data_have_a_reason() {
    let dir = tempfile::tempdir().unwrap();
    let d = definition("title='x'\ndata='bench-data/none.nrrd'\nisovalues=[1]\nanalysis='a'");
    let s = scene(&d, &[], &settings(dir.path()), &Stop::default()).unwrap();
    assert!(s.skipped.is_some_and(|r| r.contains("none.nrrd")));
    let d = definition("title='x'\ndata='synthetic:nothing'\nisovalues=[1]\nanalysis='a'");
    assert!(
        scene(&d, &[], &settings(dir.path()), &Stop::default())
            .unwrap()
            .skipped
            .is_some()
    );
}
