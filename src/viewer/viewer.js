// The kickdrift viewer: a scene that turns, in a page, in a notebook, or beside a run that goes on.
//
//   const view = await mount(element, scene, {live: false});
//
// `element` is any empty block element with a size. `scene` is the plain object of kickdrift.view.scene.scene_of.
// `mount` fills the element and returns, once the first frames are unpacked:
//
//   view.append(chunk)        adds the moments of a chunk (Stage.chunk in Python) and returns a promise. With {live: true},
//                             a view at its last frame moves on to the new last frame.
//   view.addCurves(curves)    adds points to the curves of these names (kickdrift.view.curves.curve), or new curves
//   view.say(text)            shows a line of status beside the title, such as a rate and the time left
//   view.setFrame(k)          shows frame k
//   view.frame, view.count    the number of the frame that is shown, and how many frames there are
//   view.play(), view.pause() start and stop playing
//   view.setColour(name)      colours the particles by "species", "speed", … (scene.colours)
//   view.snapshot()           returns a promise of a PNG Blob of the picture
//   view.saveSnapshot()       downloads that PNG
//   view.fps                  frames drawn per second over the last second of playing
//   view.dispose()            stops drawing, frees the graphics memory and empties the element
//
// All text is set by textContent. The viewer loads nothing and sends nothing. Two views may share a page.
// The bundle (`npm run build` writes src/kickdrift/view/assets/viewer.js) is an ES module: it exports `mount`, and it also
// sets globalThis.kickdriftView = {mount} for pages and widgets that hold the bundle as text.
