import ij.ImagePlus;
import ij.io.Opener;
import ij.measure.Calibration;
import ij.plugin.FolderOpener;

/** What ImageJ takes an image, and a folder of images, to be. */
public class ImageScale {
    public static void main(String[] paths) {
        show("an image", new Opener().openImage(paths[0]));
        show("a folder of images", FolderOpener.open(paths[1]));
    }

    private static void show(String what, ImagePlus image) {
        Calibration c = image.getCalibration();
        System.out.printf(
            "| %s | ImageJ %s | %d x %d px, %d bit, %d slices; a pixel is %s %s; frame interval %s %s |%n",
            what, ij.IJ.getVersion(), image.getWidth(), image.getHeight(), image.getBitDepth(), image.getStackSize(),
            c.pixelWidth, c.getUnits(), c.frameInterval, c.getTimeUnit());
    }
}
