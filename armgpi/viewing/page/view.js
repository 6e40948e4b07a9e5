// The page that shows the scene alone.
"use strict";

(async () => {
  try {
    const { meta, array } = await Armgpi.unpack();
    const by = (id) => document.getElementById(id);
    const pane = by("scene"), panel = by("panel");
    const scene = new Armgpi.ArmScene(pane, meta, array);
    let player = null;
    if (scene.clip) {
      Armgpi.gauges(scene, by("gauges"));
      player = new Armgpi.Player(scene, by("player"), meta.autoplay);
      if (window.innerWidth < 700) panel.open = false;
    } else {
      Armgpi.sliders(scene, by("sliders"));
    }
    Armgpi.switches(scene, by("switches"));
    // The arm stands beside the panel, where there is room for both.
    const make_room = () => scene.leave_room(panel.open ? panel.offsetLeft + panel.offsetWidth : 0, pane);
    panel.addEventListener("toggle", make_room);
    make_room();
    if (meta.live) {
      // A program that moves the arm while one looks.
      new EventSource("live").onmessage = (event) => {
        const said = JSON.parse(event.data);
        scene.configuration.set(Array.isArray(said) ? said : said.q);
        scene.show(0);
        if (said.texts) Armgpi.told(said, by("gauges"));
      };
    }
    window.armgpi = { ready: true, error: null, scene, player };
  } catch (error) {
    Armgpi.complain(error);
    throw error;
  }
})();
