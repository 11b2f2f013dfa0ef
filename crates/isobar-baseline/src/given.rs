//! What every ruler keeps of a scene besides its data: surfaces and view, checked when they are set.

use crate::support::{self, Isovalues};
use isobar_core::{MethodInfo, RenderError, Request, Surface, TransferFunction, View};

/// Surfaces and view, and whether the last frame shows them.
#[derive(Debug)]
pub(crate) struct Given {
    info: &'static MethodInfo,
    surfaces: Option<Isovalues>,
    view: Option<View>,
    drawn: bool,
}

impl Given {
    /// Nothing yet; refuses requests that no ruler can serve.
    pub(crate) fn new(info: &'static MethodInfo, request: &Request) -> Result<Self, RenderError> {
        support::check_request(info, request)?;
        Ok(Self {
            info,
            surfaces: None,
            view: None,
            drawn: false,
        })
    }

    /// The isovalues of some surfaces, not yet set.
    pub(crate) fn isovalues(&self, surfaces: &[Surface]) -> Result<Isovalues, RenderError> {
        Ok(Isovalues::new(self.info, surfaces)?)
    }

    pub(crate) fn set_surfaces(&mut self, surfaces: Isovalues) {
        self.surfaces = Some(surfaces);
        self.drawn = false;
    }

    pub(crate) fn set_medium(&self, medium: Option<&TransferFunction>) -> Result<(), RenderError> {
        Ok(support::check_medium(self.info, medium)?)
    }

    /// The view, where it can be drawn; it is set by [`Given::set_view`].
    pub(crate) fn check_view(&self, view: &View) -> Result<(), RenderError> {
        support::check_open_cuts(self.info, view)?;
        view.validate()
    }

    /// A view that was checked.
    pub(crate) fn set_view(&mut self, view: &View) {
        self.view = Some(view.clone());
        self.drawn = false;
    }

    /// Data or knobs changed.
    pub(crate) fn changed(&mut self) {
        self.drawn = false;
    }

    /// A frame of all this is complete.
    pub(crate) fn drew(&mut self) {
        self.drawn = true;
    }

    pub(crate) fn surfaces(&self) -> Option<&Isovalues> {
        self.surfaces.as_ref()
    }

    pub(crate) fn view(&self) -> Option<&View> {
        self.view.as_ref()
    }

    /// Surfaces and view, for drawing.
    pub(crate) fn scene(&self) -> Result<(&Isovalues, &View), RenderError> {
        let surfaces = self.surfaces().ok_or(RenderError::NotReady("set_surfaces"))?;
        Ok((surfaces, self.view().ok_or(RenderError::NotReady("set_view"))?))
    }

    /// The view of the last frame.
    ///
    /// # Errors
    /// [`RenderError::NotReady`] where nothing was drawn since the last change.
    pub(crate) fn frame(&self) -> Result<&View, RenderError> {
        match (&self.view, self.drawn) {
            (Some(view), true) => Ok(view),
            _ => Err(RenderError::NotReady("render")),
        }
    }
}
